"""Heavy traffic: every session of any service is answered, as often as theory says."""

import json
from collections import Counter
from itertools import pairwise
from math import sqrt
from pathlib import Path

import networkx
import pytest
from conftest import ROOT
from limits import PROGRAM_S
from loaded import run_qmn

from evidence.traffic.erlang import erlang_b
from topologies.system.runs.runtime import EVENT_CAPTURE
from views.events.event_sources import recorded

SESSIONS, FIBERS = 70, 2
SIDES = [",".join(f"{side}{n}" for n in range(1, 7)) for side in "ab"]


def holders_of_trunk(run: Path) -> dict[str, list[str]]:
    """Return whose light left q1 by each fibre, in order, by what q1's optics did.

    Host aN is at port N + 1 of q1, as trunk.py lays them.
    """
    found: dict[str, list[str]] = {}
    for event in recorded(run / EVENT_CAPTURE, follow=False):
        if (event.node, event.kind) == ("q1", "open"):
            in_port, _arrow, out_port = event.detail.split()[:3]
            found.setdefault(out_port, []).append(f"a{int(in_port) - 1}")
    return found


@pytest.mark.waits
def test_light_is_handed_out_in_slots_and_none_is_given_too_late(tmp_path: Path) -> None:
    """Six ask at once for two fibres; of slots of half a second, two or three begin in 1.2 s."""
    policy, trace = tmp_path / "policy.toml", tmp_path / "trace.csv"
    policy.write_text('[queue]\norder = "slots"\nslot_s = 0.5\n')
    rows = [f"0.1,a{n},b{n},0.05,1.2,{n}" for n in range(1, 7)]
    header = "at_s,opener,acceptor,holding_s,deadline_s,priority"
    trace.write_text("\n".join([header, *rows]) + "\n")
    words = ["run", "load", "--topology", f"{ROOT}/docs/traffic/trunk.py:Trunk", "--source", "own"]
    words += [
        "--traffic",
        "trace",
        "--file",
        str(trace),
        "--policy",
        str(policy),
        "--captures",
        "none",
    ]
    words += ["--from", SIDES[0], "--to", SIDES[1], "--time", "paced=12"]  # quick software
    done = run_qmn(*words, "--runs", str(tmp_path), timeout_s=PROGRAM_S)
    assert done.returncode == 0, done.stdout + done.stderr
    load = json.loads((tmp_path / "latest" / "result.json").read_text())["job"]["load"]
    assert (load["offered"], load["forgotten"], load["blocked"]) == (6, 0, {})
    assert load["accepted"] + load["late"] == 6
    assert load["accepted"] in (4, 5, 6)
    assert load["queued"] >= 4  # two may come when a slot begins
    holders = holders_of_trunk(tmp_path / "latest")
    assert load["waits"]
    for wait in load["waits"]:
        order = next(o for o in holders.values() if wait["opener"] in o)
        assert order[order.index(wait["opener"]) - 1] == wait["after_opener"]
    assert "Who waited for whom" in (tmp_path / "latest" / "report.html").read_text()


def test_switches_on_the_way_swap_for_sessions_in_both_directions(tmp_path: Path) -> None:
    """Parts are perfect: all pairs are Phi+, of two Bell measurements each."""
    trace = tmp_path / "trace.csv"
    trace.write_text("at_s,opener,acceptor\n0.1,alice,bob\n2,bob,alice\n")
    words = ["run", "load", "--service", "swap", "--topology", "chain,2", "--traffic", "trace"]
    words += ["--file", str(trace), "--count", "30", "--captures", "none", "--without", "report"]
    done = run_qmn(*words, "--runs", str(tmp_path), timeout_s=PROGRAM_S)
    assert done.returncode == 0, done.stdout + done.stderr
    load = json.loads((tmp_path / "latest" / "result.json").read_text())["job"]["load"]
    assert (load["accepted"], load["pairs"]) == (2, 60)
    assert [(each["fidelity"], each["pairs"]) for each in load["fidelity_by_age"]] == 2 * [(1, 30)]
    events = recorded(tmp_path / "latest" / EVENT_CAPTURE, follow=False)
    swaps = Counter(event.node for event in events if event.kind == "bell-measure")
    assert swaps == {"q1-analyser1": 2, "q2-analyser1": 2}  # blocks


@pytest.mark.nightly
@pytest.mark.waits
@pytest.mark.parametrize(
    ("service", "count", "parts"),
    [
        # Light between neighbours, from each to the next.
        ("ghz", 30, [("kscyng", "dnvrng"), ("dnvrng", "sttlng"), ("sttlng", "snvang")]),
        ("sense", 30, [("kscyng", "dnvrng"), ("dnvrng", "sttlng")]),
        ("graph", 30, [("kscyng", "dnvrng"), ("dnvrng", "snvang")]),
        ("conference", 3000, [("kscyng", "dnvrng"), ("dnvrng", "sttlng")]),
        # Halves from the source in Denver to both, then what one passes on, and what goes back.
        ("sdc_return", 30, [("src", "kscyng"), ("src", "snvang"), ("snvang", "kscyng")]),
    ],
)
def test_light_of_any_service_goes_by_the_shortest_ways_of_the_map(
    service: str, count: int, parts: list[tuple[str, str]], tmp_path: Path
) -> None:
    """Fibres in use are those of shortest ways, as networkx finds them; each part is a path."""
    back = service == "sdc_return"
    hosts = ["kscyng", "snvang"] if back else [parts[0][0], *(end for _start, end in parts)]
    trace = tmp_path / "trace.csv"
    opener, acceptor, *others = hosts
    trace.write_text(f"at_s,opener,acceptor,others\n0.1,{opener},{acceptor},{' '.join(others)}\n")
    words = ["run", "load", "--topology", "map,abilene,hosts_at=kscyng,dnvrng,sttlng,snvang"]
    words += [
        "--service",
        service,
        "--count",
        f"{count}",
        "--traffic",
        "trace",
        "--captures",
        "none",
    ]
    words += ["--file", str(trace), *([] if back else ["--line", f"{len(hosts)}"])]
    done = run_qmn(*words, "--runs", str(tmp_path), timeout_s=PROGRAM_S)
    assert done.returncode == 0, done.stdout + done.stderr
    result = json.loads((tmp_path / "latest" / "result.json").read_text())
    load = result["job"]["load"]
    (session,) = load["sessions"]
    assert (session["outcome"], session["others"]) == ("accepted", others), session["text"]
    assert result["path_setup_ms"]["n"] == (2 if back else len(hosts) - 1)  # sessions with light
    network = result["network"]
    graph = networkx.Graph()
    for fiber in network["fibers"]:
        ends = [fiber[end]["node"] for end in ("a", "b")]
        graph.add_edge(*ends, length_km=fiber["length_km"])
    ways = [networkx.dijkstra_path(graph, *ends, weight="length_km") for ends in parts]
    if back:
        ways.append(ways[-1][::-1])
    wanted = Counter(ends for way in ways for ends in pairwise(way))
    used = [name.split(" → ") for name, share in load["fibers"].items() if share]
    assert Counter(tuple(node_of(end) for end in ends) for ends in used) == wanted
    report = (tmp_path / "latest" / "report.html").read_text()
    assert "Sessions over time, and the use of every fibre" in report


def node_of(end: str) -> str:
    """Return whose port or interface this is: q1 of q1:8, rm1 of rm1-q0."""
    return end.partition(":")[0].rpartition("-q")[0] or end.partition(":")[0]


@pytest.mark.nightly
def test_two_fibres_are_busy_as_often_as_erlang_says(tmp_path: Path) -> None:
    words = ["run", "load", "--topology", f"{ROOT}/docs/traffic/trunk.py:Trunk", "--seed", "1"]
    words += [
        "--from",
        SIDES[0],
        "--to",
        SIDES[1],
        "--source",
        "own",
        "--idle",
        "--captures",
        "none",
    ]
    words += ["--sessions", f"{SESSIONS}", "--rate-per-s", "12", "--holding-s", "0.15"]
    done = run_qmn(*words, "--runs", str(tmp_path), timeout_s=PROGRAM_S)
    assert done.returncode == 0, done.stdout + done.stderr
    result = json.loads((tmp_path / "latest" / "result.json").read_text())
    load = result["job"]["load"]
    assert (load["offered"], load["forgotten"], load["broken"]) == (SESSIONS, 0, {})
    assert set(load["blocked"]) <= {"BUSY", "NO_IDLE_HOST"}
    assert load["accepted"] + sum(load["blocked"].values()) == SESSIONS
    assert load["accepted"] == result["path_setup_ms"]["n"]  # the controller's own count
    # Of the sessions that came as far as the controller, as long as light was really held.
    asked = [each for each in load["sessions"] if each["reason"] != "NO_IDLE_HOST"]
    busy = load["blocked"].get("BUSY", 0) / len(asked)
    erlangs = len(asked) / asked[-1]["asked_s"] * load["light_s"]
    wanted = erlang_b(erlangs, FIBERS)
    assert abs(busy - wanted) < 5 * sqrt(wanted * (1 - wanted) / len(asked))
    used = {name for name, share in load["fibers"].items() if share and name.startswith("q1:")}
    assert used <= {"q1:8 → q2:8", "q1:9 → q2:9"}  # light goes from a to b alone
    assert [each["fidelity"] for each in load["fidelity_by_age"]] == [1.0] * 5  # ideal memories
    report = (tmp_path / "latest" / "report.html").read_text()
    assert "Sessions over time, and the use of every fibre" in report
