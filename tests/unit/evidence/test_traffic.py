"""Heavy traffic: its models, the closed forms of its theory, and what is counted of it."""

import re
from collections import Counter
from dataclasses import replace
from itertools import pairwise, permutations
from math import factorial, sqrt
from pathlib import Path
from statistics import fmean
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from evidence.traffic import job_result
from evidence.traffic.erlang import erlang_b, erlang_c, mean_wait
from evidence.traffic.job import checked
from evidence.traffic.plan import BadTraffic, Planned, Traffic, plan
from evidence.traffic.request import LoadRequest
from evidence.traffic.session import Outcome, Wanted, like_phi_plus
from evidence.traffic.summary import fairness, fidelity_by_age, light_times, summary, waits
from hosts.middleware.services import named
from qmn.__main__ import described
from qmn.options import BadInput, read
from views.fiber_use import fiber_use, shares, span_of
from views.report.waits_diagram import waited, waits_diagram
from wire.config import QuantumSwitch
from wire.dispatcher_pb2 import Event
from wire.metadata.vocabulary import Service
from wire.parameters.fiber import Fiber, FiberEnd
from wire.results.run_result import ACCEPTED, BLOCKED, LoadJob, LoadWait, NetworkFacts, Shares
from wire.services import LINES

HOSTS = ["h1", "h2", "h3"]
PLAIN = Traffic(HOSTS, HOSTS, rate_per_s=20.0, holding_s=0.5)


def in_file(path: Path, text: str) -> Traffic:
    path.write_text(text)
    return Traffic(HOSTS, HOSTS, 20.0, 0.5, file=path)


def test_poisson_arrivals_and_holding_times_have_the_means_and_spreads_of_exponentials() -> None:
    """The standard error of the mean of n exponentials is mean / sqrt(n)."""
    found = plan("poisson", PLAIN, seed=1, sessions=20_000)
    gaps = [later.at_s - earlier.at_s for earlier, later in pairwise(found)]
    for values, mean in ((gaps, 1 / 20), ([each.holding_s for each in found], 0.5)):
        assert abs(fmean(values) - mean) < 5 * mean / sqrt(len(values))
        # The variance of an exponential's sample variance is 8 mean^4 / n.
        assert abs(np.var(values) - mean**2) < 5 * mean**2 * sqrt(8 / len(values))
    pairs = {(each.opener, each.acceptor) for each in found}
    assert pairs == {(one, two) for one in HOSTS for two in HOSTS if one != two}
    assert plan("poisson", PLAIN, seed=1, sessions=20) == found[:20]
    assert plan("poisson", PLAIN, seed=2, sessions=20) != found[:20]


def test_bursts_have_the_same_mean_rate_and_a_larger_spread() -> None:
    """Counts of a Poisson process in a second vary as their mean; those of bursts vary more."""
    bursty = Traffic(HOSTS, HOSTS, 20.0, 0.5, on_s=0.5, off_s=1.5)
    found = plan("on-off", bursty, seed=1, sessions=20_000)
    assert [each.at_s for each in found] == sorted(each.at_s for each in found)
    counts = np.bincount([int(each.at_s) for each in found])[:-1]
    # Seconds are correlated for about as long as a burst, on plus off: blocks of ten are not.
    blocks = counts[: counts.size // 10 * 10].reshape(-1, 10).mean(axis=1)
    assert abs(blocks.mean() - 20) < 5 * blocks.std() / sqrt(blocks.size)
    assert counts.var() > 2 * counts.mean()


def test_a_matrix_says_who_asks_whom_how_often(tmp_path: Path) -> None:
    rates = in_file(tmp_path / "m.csv", "opener,acceptor,rate_per_s\nh1,h2,3\nh3,h1,1\nh2,h3,0\n")
    found = plan("matrix", rates, seed=1, sessions=4_000)
    first = sum((each.opener, each.acceptor) == ("h1", "h2") for each in found)
    assert abs(first / 4_000 - 0.75) < 5 * sqrt(0.75 * 0.25 / 4_000)
    assert not any(each.opener == "h2" for each in found)
    assert abs(found[-1].at_s - 1_000) < 5 * sqrt(4_000) / 4


def test_a_trace_is_played_in_its_order_of_time(tmp_path: Path) -> None:
    columns = "at_s,opener,acceptor,holding_s,deadline_s,priority"
    text = f"{columns}\n2,h1,h2,0.25,,\n1,h2,h3,0,0.75,2\n"
    assert plan("trace", in_file(tmp_path / "t.csv", text), seed=1, sessions=9) == [
        Planned(1.0, "h2", "h3", 0.0, 0.75, priority=2),
        Planned(2.0, "h1", "h2", 0.25, None),
    ]


def test_a_share_of_the_sessions_is_urgent_and_the_rest_of_the_plan_is_by_chance() -> None:
    found = plan("poisson", replace(PLAIN, urgent=0.3), seed=1, sessions=4_000)
    share = sum(each.priority for each in found) / 4_000
    assert abs(share - 0.3) < 5 * sqrt(0.3 * 0.7 / 4_000)
    assert not any(each.priority for each in plan("poisson", PLAIN, seed=1, sessions=100))


@pytest.mark.parametrize(
    ("model", "text", "refusal"),
    [
        (
            "trace",
            "at_s,opener\n1,h1\n",
            "it needs acceptor, at_s, opener, and may have deadline_s",
        ),
        ("trace", "at_s,opener,acceptor\n1,h1,h9\n", "acceptor 'h9' is not one of h1, h2, h3"),
        ("trace", "at_s,opener,acceptor\n-1,h1,h2\n", "at_s '-1' is not a number from 0 on"),
        ("trace", "at_s,opener,acceptor\nnan,h1,h2\n", "at_s 'nan' is not a number from 0 on"),
        ("trace", "at_s,opener,acceptor\n1,h1,h1\n", "h1 asks itself; name two hosts"),
        ("trace", "at_s,opener,acceptor\n", "names no sessions"),
        ("trace", "at_s,opener,acceptor,priority\n1,h1,h2,0.5\n", "priority 0.5: choose 0 to 255"),
        ("matrix", "opener,acceptor,rate_per_s\nh1,h2,0\n", "names no rate above 0"),
    ],
)
def test_a_file_that_is_no_traffic_is_refused(
    tmp_path: Path, model: str, text: str, refusal: str
) -> None:
    with pytest.raises(BadTraffic, match=refusal):
        plan(model, in_file(tmp_path / "bad.csv", text), seed=1, sessions=9)


def stationary(
    load: float, channels: int, places: int
) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """Return how likely 0, 1, … sessions are, by solving the balance of a birth-death chain."""
    rates = np.zeros((places + 1, places + 1))
    for state in range(places):
        rates[state, state + 1] = load
        rates[state + 1, state] = min(state + 1, channels)
    balance = rates.T - np.diag(rates.sum(axis=1))
    balance[-1] = 1.0
    return np.linalg.solve(balance, np.eye(places + 1)[-1])


@pytest.mark.parametrize(("load", "channels"), [(0.5, 1), (2.0, 4), (8.0, 10), (3.9, 4)])
def test_erlang_s_formulas_are_what_the_balance_equations_give(load: float, channels: int) -> None:
    terms = [load**n / factorial(n) for n in range(channels + 1)]
    assert erlang_b(load, channels) == pytest.approx(terms[-1] / sum(terms))
    assert erlang_b(load, channels) == pytest.approx(stationary(load, channels, channels)[-1])
    chain = stationary(load, channels, 1500)  # in which that number wait as good as never
    assert erlang_c(load, channels) == pytest.approx(chain[channels:].sum())
    waiting = sum(n * share for n, share in enumerate(chain[channels:]))
    assert mean_wait(load, channels, 0.2) == pytest.approx(waiting / load * 0.2)  # Little


def test_erlang_b_is_that_of_the_tables() -> None:
    """Ten erlangs on ten channels: 21.46 %. Erlang C is 1 where all channels are always taken."""
    assert erlang_b(10.0, 10) == pytest.approx(0.2146, abs=5e-5)
    assert erlang_c(4.0, 4) == 1.0


def outcome(opener: str, kind: str = ACCEPTED, reason: str = "", **more: object) -> Outcome:
    report = Outcome(Planned(0.0, opener, "h9", 0.1), opener, "h9", 0.0, kind, reason)
    for name, value in more.items():
        setattr(report, name, value)
    return report


def test_jain_s_index_is_one_if_all_fare_alike_and_a_third_if_one_of_three_has_all() -> None:
    assert fairness([outcome(host) for host in HOSTS]) == pytest.approx(1)
    blocked = [outcome(host, BLOCKED, "BUSY") for host in HOSTS[1:]]
    assert fairness([outcome("h1"), *blocked]) == pytest.approx(1 / 3)
    assert fairness(blocked) is None
    often = [outcome("h1"), outcome("h1", BLOCKED, "BUSY")] * 3  # who asks more has more, not else
    seldom = [outcome("h2"), outcome("h2", BLOCKED, "BUSY")]
    assert fairness(often + seldom) == pytest.approx(1)


def test_every_session_is_counted_once() -> None:
    reports = [
        outcome("h1", setup_s=0.25, ended_s=2.0, summary={"pairs": 6}),
        outcome("h2", "late"),
    ]
    reports += [outcome("h1", BLOCKED, "BUSY"), outcome("h3", BLOCKED, "BUSY"), outcome("h3", "")]
    found = summary(reports, [])
    assert (found.offered, found.accepted, found.late, found.forgotten) == (5, 1, 1, 1)
    assert (found.blocked, found.broken) == ({"BUSY": 2}, {})
    assert found.setup_s == Shares(0.25, 0.25, 0.25, 1)
    assert found.pairs_per_s == 3.0


def test_the_load_is_that_of_sessions_by_littles_law() -> None:
    """A session a second, each a quarter of a second without light and two with it."""
    reports = [outcome("h1", asked_s=at, setup_s=0.25, ended_s=at + 2.25) for at in range(100)]
    found = summary(reports, [])
    assert found.offered_per_s == pytest.approx(100 / 99)
    assert found.at_a_time == 3
    assert found.carried == pytest.approx(100 * 2 / 101.25)


def test_the_controller_s_record_says_who_waited_and_who_had_light() -> None:
    events = [("queued", 0), ("path_ready", 3), ("torn_down", 7), ("torn_down", 9)]
    record = [{"session": "7", "event": event, "time_ns": at * 10**9} for event, at in events]
    found = light_times(record, scale=2.0)
    assert (found["queued"], found["waited_s"].p50, found["light_s"]) == (1, 1.5, 2.0)


def test_the_controller_s_record_says_who_waited_for_whom() -> None:
    """On a clock that is twice as slow, a waits from 2 to 6, and then b from 3 to 10, for a."""
    names = {"10.0.0.1": "h1", "10.0.0.2": "h2", "10.0.0.3": "h3"}
    ends = {
        "x": ["10.0.0.1", "10.0.0.2"],
        "a": ["10.0.0.1", "10.0.0.3"],
        "b": ["10.0.0.3", "9.9.9.9"],
    }
    lines = [("queued", "a", 2, ""), ("queued", "b", 3, ""), ("light_after", "a", 5, "x")]
    lines += [("path_ready", "a", 6, ""), ("light_after", "b", 9, "a"), ("path_ready", "b", 10, "")]
    lines += [("path_ready", "c", 11, "")]  # which never waited
    record = [
        {"event": event, "session": session, "time_ns": at * 10**9}
        | ({"ends": ends[session], "after": {"session": of, "ends": ends[of]}} if of else {})
        for event, session, at, of in lines
    ]
    first, second = waits(record, 2.0, 10**9, names)
    assert first == LoadWait("b", "h3", "9.9.9.9", 4.5, 3.5, "a", "h1", "h3")
    assert second == LoadWait("a", "h1", "h3", 2.5, 2.0, "x", "h1", "h2")
    assert waited([first, second, first]) == {("h3", "h1"): 7.0, ("h1", "h1"): 2.0}


def test_the_hosts_with_the_longest_waits_are_shown() -> None:
    reports = [LoadWait("", f"h{n:02}", "", 0.0, n + 1.0, "", "src", "") for n in range(30)]
    assert set(waited(reports)) == {(f"h{n}", "src") for n in range(15, 30)}  # and src: 16


def test_who_waited_has_a_row_and_whose_light_it_was_a_column() -> None:
    """Of two that waited for the light of three: each wait is drawn where both meet."""
    reports = [("h1", "a", 1.0), ("h1", "c", 3.0), ("h2", "b", 5.0), ("h2", "c", 7.0)]
    drawn = waits_diagram(
        [LoadWait("", host, "", 0.0, waited_s, "", other, "") for host, other, waited_s in reports]
    )
    found = re.findall(r'<text[^>]* x="([\d.]+)" y="([\d.]+)"[^>]*>([^<]*)<', drawn)
    place = {text: (float(x), float(y)) for x, y, text in found}
    for host, other, waited_s in reports:
        x, y = place[f"{waited_s:.2g}"]
        assert abs(x - place[other][0]) < 1, "under the name of its column"
        assert abs(y - place[host][1]) < 8, "in the row of its name"
    assert place["a"][0] < place["b"][0] < place["c"][0]
    assert abs(place["h1"][1] - place["h2"][1]) > 16


def test_a_third_of_the_outcomes_in_each_basis_gives_the_fidelity_of_a_werner_pair() -> None:
    """Halves agree as those of Phi+ with probability (1 + c) / 2, where F = (1 + 3c) / 4."""
    report = outcome("h1", measured=dict.fromkeys("XYZ", 1000), right=dict.fromkeys("XYZ", 900))
    (found,) = fidelity_by_age([report])
    assert found.fidelity == pytest.approx((1 + 3 * 0.8) / 4)
    # Var F = (1/4)^2 * 3 * 4 * s (1 - s) / n
    assert found.standard_error == pytest.approx(sqrt(3 / 4 * 0.9 * 0.1 / 1000))


@pytest.mark.parametrize("sessions", [1, 4, 6, 23])
def test_a_fifth_of_the_sessions_is_in_each_portion_by_age(sessions: int) -> None:
    outcomes_of_a_basis = dict.fromkeys("XYZ", 1)
    reports = [
        outcome("h1", age_s=float(age), measured=outcomes_of_a_basis, right=outcomes_of_a_basis)
        for age in range(sessions)
    ]
    portions = [each.pairs // 3 for each in fidelity_by_age(reports)]
    assert (sum(portions), len(portions)) == (sessions, min(sessions, 5))
    assert max(portions) - min(portions) <= 1


def test_a_fibre_is_in_use_in_the_direction_of_its_light() -> None:
    fibers = [
        Fiber(FiberEnd("h1", "h1-q0"), FiberEnd("q1", "1")),
        Fiber(FiberEnd("q1", "2"), FiberEnd("q2", "1")),
    ]
    network = NetworkFacts({}, "", fibers, [QuantumSwitch("q1"), QuantumSwitch("q2")], [])
    events = [
        Event(time_ns=100, node="q1", kind="open", port="1", detail="1 -> 2"),
        Event(time_ns=150, node="q2", kind="open", port="1", detail="1 -> 5"),
        Event(time_ns=300, node="q1", kind="close", port="1"),
        Event(time_ns=400, node="q1", kind="open", port="2", detail="2 -> 1"),
        Event(time_ns=500, node="q2", kind="close", port="1"),
    ]
    use = fiber_use(network, events)
    assert use == {
        "h1-q0 → q1:1": [(100, 300)],
        "q1:1 → h1-q0": [(400, 500)],
        "q1:2 → q2:1": [(100, 300)],
        "q2:1 → q1:2": [],
    }
    assert span_of(use) == (100, 500)
    assert shares(use, 100, 500)["q1:2 → q2:1"] == 0.5


def asked(*words: str) -> tuple[Traffic, list[Planned], Wanted]:
    """Return what the command line asks for."""
    whole = ["run", "load", *words]
    request = read(LoadRequest, described(whole).parse_args(whole))
    return checked(request)[2:]


def test_a_map_goes_in_place_of_the_ring_but_not_of_what_is_named(
    capsys: pytest.CaptureFixture[str],
) -> None:
    """GARR has these places, the ring alice and bob."""
    words = ["--topology", "map,garr,hosts_at=rm1,mi1,na", "--sessions", "1"]
    assert asked(*words)[0].openers == ["mi1", "na", "rm1"]
    with pytest.raises(SystemExit):
        asked("--topology", "ring,map=garr")
    assert "map is of map, not of ring: leave it out" in capsys.readouterr().err


def test_sources_neither_ask_nor_are_asked_unless_they_are_named() -> None:
    traffic, planned, wanted = asked("--sessions", "7")
    assert (traffic.openers, traffic.acceptors) == (["alice", "bob"], ["alice", "bob"])
    assert (len(planned), wanted.service, wanted.measures) == (7, Service.DISTRIBUTE, True)
    named, _planned, _wanted = asked("--from", "charlie,bob")
    assert named.openers == ["charlie", "bob"]


def test_every_service_that_is_offered_can_be_asked_for() -> None:
    """In services of lines hosts make pairs each with the next: as many as are asked for."""
    for name in named():
        words = "--service", name, "--sessions", "1", "--to", "alice,bob,charlie"
        traffic, (session,), wanted = asked(*words)
        hosts = {session.opener, session.acceptor, *session.others}
        assert len(hosts) == traffic.hosts == (3 if wanted.service in LINES else 2)
        assert wanted.service.name.lower() == name
        assert wanted.goes_back_on == (Service.SDC if name == "sdc_return" else None)


def test_the_switches_between_both_ends_of_a_session_swap() -> None:
    """In the ring of q1 to q4 hosts are at q1, q3 and q2: three, two and two are on the way."""
    words = "--service", "swap", "--to", "alice,bob,charlie", "--from", "alice,bob,charlie"
    ends = {("alice", "bob"): 3, ("alice", "charlie"): 2, ("bob", "charlie"): 2}
    both_ways = ends | {(b, a): number for (a, b), number in ends.items()}
    for more in (["--idle"], ["--sessions", "200"]):
        _traffic, _planned, wanted = asked(*words, *more)
        assert (wanted.swaps, wanted.measures) == (both_ways, True)
    assert asked("--sessions", "1")[2].swaps == {}


@pytest.mark.parametrize(
    ("words", "refusal"),
    [
        (["--switch", "q1.analysers=0"], "switch with a Bell analyser between them"),
        (["--source", "own"], "both ends make pairs"),
    ],
)
def test_swaps_that_no_switch_or_another_source_would_do_are_refused(
    words: list[str], refusal: str
) -> None:
    with pytest.raises(BadInput, match=refusal):
        asked("--service", "swap", *words)


def test_the_hosts_of_a_line_are_any_in_any_order_all_alike() -> None:
    """Of four hosts 24 lines of three can be made; each is as likely as any other."""
    hosts = [*HOSTS, "h4"]
    found = plan("poisson", Traffic(hosts, hosts, 20.0, 0.5, hosts=3), seed=1, sessions=24_000)
    lines = Counter((each.opener, each.acceptor, *each.others) for each in found)
    assert lines.keys() == set(permutations(hosts, 3))
    spread = sqrt(24_000 * (1 / 24) * (23 / 24))
    assert all(abs(count - 1_000) < 5 * spread for count in lines.values())


@pytest.mark.parametrize("model", ["trace", "matrix"])
def test_a_file_may_say_who_else_takes_part(tmp_path: Path, model: str) -> None:
    text = "at_s,opener,acceptor,others\n1,h1,h2,h4 h3\n"
    if model == "matrix":
        text = "rate_per_s,opener,acceptor,others\n1,h1,h2,h4 h3\n"
    hosts = [*HOSTS, "h4"]
    given = replace(in_file(tmp_path / "t.csv", text), openers=hosts, acceptors=hosts, hosts=4)
    assert [each.others for each in plan(model, given, seed=1, sessions=1)] == [("h4", "h3")]
    with pytest.raises(BadTraffic, match="h1, h2, h4, h3: a session has 3 hosts, each once"):
        plan(model, replace(given, hosts=3), seed=1, sessions=1)
    (tmp_path / "t.csv").write_text(text.replace("h4 h3", ""))
    (drawn,) = plan(model, given, seed=1, sessions=1)
    assert set(drawn.others) == {"h3", "h4"}


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (["--from", "dave"], "--from dave: choose one of alice, bob, charlie"),
        (["--from", "bob", "--to", "bob"], "--from bob --to bob: name more hosts"),
        (["--source", "dave"], "--source dave: choose one of own, alice, bob, charlie"),
        (["--service", "ghz", "--line", "17"], "--line 17: choose 2 to 16"),
        (["--service", "ghz", "--line", "3"], "--to alice,bob: name more hosts, 3 take part in"),
        (["--line", "3"], "--line: in distribute 2 hosts take part: leave it out"),
        (["--rate-per-s", "0"], "--rate-per-s 0.0: choose 1e-06 to"),
        (["--count", "1048577"], "--count 1048577: choose 1 to 1048576"),  # as long keys are
        (["--sessions", "0"], "--sessions 0: choose 1 to 100000"),
        (["--traffic", "trace"], "name a file with the columns acceptor, at_s, opener"),
        (["--file", "x.csv"], "--file is of --traffic matrix or trace, not of poisson"),
        (["--idle", "--traffic", "on-off"], "--idle is of --traffic poisson"),
    ],
)
def test_traffic_that_cannot_be_is_refused(words: list[str], text: str) -> None:
    with pytest.raises(BadInput) as caught:
        asked(*words)
    assert text in str(caught.value)


@pytest.mark.parametrize(("basis", "alike"), [("X", 2), ("Y", 1), ("Z", 2)])
def test_outcomes_that_both_hosts_have_are_held_against_phi_plus(basis: str, alike: int) -> None:
    """Both halves of Phi+ are equal in X and Z, and differ in Y."""
    answers = [{"outcomes": [0, 1, 1, None, 0]}, {"outcomes": [0, 1, 0, 1, None]}]
    assert like_phi_plus(answers, basis) == (alike, 3)


def test_without_events_a_load_is_complete_but_for_the_use_of_fibres(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("evidence.traffic.job_result.result.complete", lambda *_: None)
    load = summary([outcome("h1")], [])
    facts: Any = SimpleNamespace(job=LoadJob(load=load), network=NetworkFacts({}, "", [], [], []))
    job_result.complete(facts, tmp_path)
    assert (facts.elapsed_s, facts.job.asking.sessions) == (load.span_s, 1)
