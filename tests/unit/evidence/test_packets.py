"""Applications that want packets of pairs: closed forms, and numbers of the authors' program.

arXiv:2605.28795; what their program draws is in labs/scheduling/reference.json.
"""

import json
from collections.abc import Sequence
from math import sqrt
from statistics import fmean, stdev

import numpy as np
import pytest

from controller_apps.policy.schedules import Queue
from controller_apps.sessions.arbiter import Arbiter
from evidence.curves.contention import FOR_EVER_S, address, trunk
from evidence.curves.packets import (
    Application,
    Pairs,
    Requests,
    ask_in_counted_time,
    drawn,
    of_emulated,
    timetable,
    tree_of,
)
from evidence.curves.scheduling import address as address_of
from evidence.curves.scheduling import away, network_of
from evidence.labs import catalogue
from evidence.traffic.counted import GIVEN_UP, Asked, CountedTime, Fate
from evidence.traffic.plan import Planned, Traffic, plan
from topologies.catalogue.maps import read_map
from wire.results.run_result import LoadSession

GARR = read_map("garr")
REFERENCE = json.loads((catalogue.LABS / "scheduling" / "reference.json").read_text())


def two_or_more(slots: int, chance: float) -> float:
    """Return how likely at least two of a number of slots have a pair."""
    return 1 - (1 - chance) ** slots - slots * chance * (1 - chance) ** (slots - 1)


@pytest.mark.parametrize("links", [1, 3, 8])
def test_a_window_is_the_shortest_in_which_nine_of_ten_packets_are_made(links: int) -> None:
    pairs = Pairs()
    chance = (1 - 0.999**1000) ** links * 0.6 ** (links - 1)
    assert pairs.chance(links) == pytest.approx(chance)
    window = pairs.window(links)
    assert two_or_more(window - 1, chance) < 0.9 <= two_or_more(window, chance)


@pytest.mark.parametrize("seed", range(1, 7))
def test_applications_are_those_of_the_authors_program(seed: int) -> None:
    found = drawn(tree_of(GARR, "rm2"), Pairs(), 30, seed)
    windows_s = sum(each.window for each in found) * 1e-4
    assert windows_s == pytest.approx(REFERENCE["tree 4 edf"]["windows_s"][seed - 1])


def test_there_is_a_timetable_where_the_authors_program_finds_one() -> None:
    """Commit ab9d3f05: --scheduler static --apps 100 on Garr201201.gml, seeds 1 to 8."""
    fits = [timetable(drawn(GARR, Pairs(), 100, seed), Pairs()) for seed in range(1, 9)]
    assert [seed for seed, starts in enumerate(fits, 1) if starts is not None] == [1, 3, 6, 7]


def asking(paths: list[list[str]], wanted: int, table: bool = False) -> Requests:
    pairs = Pairs()
    applications = [
        Application(path, pairs.chance(len(path) - 1), pairs.window(len(path) - 1))
        for path in paths
    ]
    starts = timetable(applications, pairs) if table else None
    return Requests(applications, pairs, wanted, 1.0, np.random.default_rng(1), starts)


def test_by_timetable_as_many_packets_are_made_as_fit_their_windows() -> None:
    """And one window is behind the other where they share a link."""
    found = asking([["rm2", "rm1"], ["rm2", "rm1", "ca1"]], 500, table=True)
    one, other = found.applications
    assert found.starts == [0.0, pytest.approx(one.window * 1e-4)]
    ask_in_counted_time(GARR, found, Queue(), 0.0)
    for each in (one, other):
        chance = two_or_more(each.window, each.chance)
        share = each.packets / each.releases
        assert abs(share - chance) < 5 * sqrt(chance * (1 - chance) / each.releases)


def test_one_that_is_alone_waits_for_nothing_but_its_messages() -> None:
    """Two ways to either end and two to the farthest switch for each attempt (Wald's equation)."""
    for times in (0, 3):
        found = asking([["rm2", "rm1"]], 400)
        ask_in_counted_time(GARR, found, Queue("edf"), times)
        assert found.share == 1.0
        (own,) = found.applications
        _network, switches = network_of(GARR)
        far_s = [times * away(GARR, switches)[switches[place]] for place in own.path]
        messages_s = 2 * sum(far_s) + 2 * max(far_s)
        slots = sum(1 - two_or_more(slot, own.chance) for slot in range(own.window))
        attempt_s = messages_s + slots * 1e-4
        wanted_s = attempt_s / two_or_more(own.window, own.chance)
        took_s = found.turnarounds_s
        assert abs(fmean(took_s) - wanted_s) < 5 * stdev(took_s) / sqrt(len(took_s))


def test_light_of_another_wavelength_does_not_share_a_fibre_the_other_way() -> None:
    """Both directions of a port have one tuning."""
    for apart_pm, waits in ((0, 0.0), (200, 1.0)):
        own = Asked.wavelength_pm
        both = [
            Asked(0.0, address(0, 0), address(1, 0), 1.0, wavelength_pm=own),
            Asked(0.0, address(1, 1), address(0, 1), 1.0, wavelength_pm=own + apart_pm),
        ]
        arbiter = Arbiter(trunk(1), FOR_EVER_S, FOR_EVER_S, queues=True)
        found = CountedTime(arbiter).run(both)
        assert [each.waited_s for each in found] == [0.0, waits]


def test_who_gives_up_asks_for_the_next_once_and_has_no_light_any_more() -> None:
    heard: list[tuple[Fate, float]] = []
    later = Asked(2.0, address(0, 2), address(1, 2), 0.5)

    def then(report: Fate, now: float) -> Asked | None:
        heard.append((report, now))
        return later if report.reason else None

    both = [
        Asked(0.0, address(0, 0), address(1, 0), 1.0),
        Asked(0.1, address(0, 1), address(1, 1), 1.0, useful_s=0.4),
    ]
    arbiter = Arbiter(trunk(1), FOR_EVER_S, FOR_EVER_S, queues=True)
    first, given_up, third = CountedTime(arbiter, then=then).run(both)
    assert [now for _told, now in heard] == pytest.approx([0.5, 1.0, 2.5])
    assert (given_up.light_s, given_up.reason, given_up.used) == (None, GIVEN_UP, False)
    assert (first.used, third.used, third.waited_s) == (True, True, 0.0)


def as_sessions(
    applications: Sequence[Application],
    pairs: Pairs,
    packets: int,
    rate_per_s: float,
    random: np.random.Generator,
) -> list[Planned]:
    """Return packets as sessions that are asked for once, for `qmn run load`; in order of time.

    Each holds its light as long as all attempts take until it is made, one behind the other, and is
    given up where the window of the last could not end by the deadline.
    """
    sessions = []
    for application in applications:
        released_s = 0.0
        for _ in range(packets):
            released_s += random.exponential(1 / rate_per_s)
            held, needed = 0, application.window + 1
            while needed > application.window:
                needed = pairs.packet + int(
                    random.negative_binomial(pairs.packet, application.chance)
                )
                held += min(needed, application.window)
            left_s = pairs.period_s - application.window * pairs.slot_s
            sessions.append(
                Planned(
                    released_s,
                    application.path[0],
                    application.path[-1],
                    held * pairs.slot_s,
                    left_s,
                )
            )
    return sorted(sessions, key=lambda each: each.at_s)


def test_packets_of_the_lab_are_those_that_the_model_draws() -> None:
    """The first thirty of ten applications with four packets a second."""
    names = [place.name for place in GARR.places]
    file = catalogue.LABS / "scheduling" / "packets.csv"
    read = plan("trace", Traffic(names, names, 1.0, 0.0, file=file), 1, 1_000)
    drew = as_sessions(drawn(GARR, Pairs(), 10, 1), Pairs(), 5, 4, np.random.default_rng(1))[:30]
    assert len(read) == len(drew)
    for one, other in zip(read, drew, strict=True):
        assert (one.opener, one.acceptor) == (other.opener, other.acceptor)
        assert one.at_s == pytest.approx(other.at_s, abs=1e-6)
        assert (one.holding_s, one.deadline_s) == pytest.approx((other.holding_s, other.deadline_s))


def test_one_packet_in_counted_time_waits_for_six_ways_of_messages() -> None:
    """To the controller, to switches and back, to the acceptor and back, and to the opener."""
    network, switches = network_of(GARR)
    far_s = away(GARR, switches)
    ends = "rm1", "mi1"
    arbiter = Arbiter(network, FOR_EVER_S, FOR_EVER_S, queues=True, order=Queue("edf"))
    opener, acceptor = (address_of(switches[end]) for end in ends)
    asked = Asked(0.0, opener, acceptor, 0.01)
    (report,) = CountedTime(arbiter, far_s.__getitem__).run([asked])
    one, other = (far_s[switches[end]] for end in ends)
    least = 2 * one + 2 * other + 2 * max(one, other)
    assert report.waited_s is not None
    assert least - 1e-9 <= report.waited_s <= 2 * one + 2 * other + 2 * max(far_s.values())


def test_packets_of_a_network_count_as_made_where_they_were_accepted() -> None:
    ways = [("accepted", 0.02, 0.01), ("late", None, 0.5), ("accepted", 0.04, 0.01)]
    sessions = [
        LoadSession(0, 0, "rm1", "mi1", [], outcome, "", "", setup_s, 1, 0, holding_s, None, None)
        for outcome, setup_s, holding_s in [*ways, ("broken", 0.1, 0.5)]
    ]
    share, took = of_emulated(sessions)
    assert share.value == 0.5
    assert took.value == pytest.approx(0.04)  # of .03 and .05
    assert took.error == pytest.approx(0.01)
