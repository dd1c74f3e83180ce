"""Where the nodes of a network stand in the report's drawing of it."""

import re
from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations, pairwise, product

import pytest

from topologies.catalogue.maps import read_map
from views.report.eavesdropped import eavesdropped
from views.report.light_paths import Hop, LightPath, fiber_name
from views.report.map_diagram import in_a_line, map_diagram
from views.report.network_diagram import network_diagram
from views.report.places import NODE_INCHES, WIDTH_INCHES, columns, of_nodes, on_paper
from wire.config import QuantumSwitch
from wire.dispatcher_pb2 import Event
from wire.parameters.fiber import Fiber, FiberEnd
from wire.results.run_result import NetworkFacts

LINE = ["q1", "q2", "q3", "q4", "q5"]
RING = [*pairwise(LINE), ("q5", "q1")]
CHAIN = [("alice", "q1"), ("charlie", "q1", "q2"), ("bob", "q2", "q3"), ("ed", "q3")]
STAGES = [(leaf, spine) for leaf in ("q1", "q2", "q3", "q4") for spine in ("q5", "q6", "q7")]


def network(switches: Sequence[str], joined: Sequence[tuple[str, str]]) -> NetworkFacts:
    """Return a network with these fibres; ed has none, and copper to s1 as all hosts."""
    hosts = ["alice", "bob", "charlie", "ed"]
    ends = [FiberEnd(node, f"{node}:{n}") for n, pair in enumerate(joined) for node in pair]
    pairs = zip(ends[::2], ends[1::2], strict=True)
    fibers = [Fiber(*pair, length_km=2, loss_db_per_km=0.2) for pair in pairs]
    copper = [["s1", f"s1-eth{n}", host, f"{host}-eth0"] for n, host in enumerate(hosts)]
    addresses = {host: f"10.0.0.{n}" for n, host in enumerate(hosts, 1)}
    return NetworkFacts(
        addresses, "charlie", fibers, [QuantumSwitch(name) for name in switches], copper
    )


def hosts_at(alice: str, charlie: str, bob: str) -> list[tuple[str, str]]:
    return [("alice", alice), ("bob", bob), ("bob", bob), ("charlie", charlie)]


@pytest.mark.parametrize(
    ("switches", "joined", "expected"),
    [
        (["q1"], hosts_at("q1", "q1", "q1"), [["alice", "bob", "charlie", "ed"], ["q1"]]),
        (
            LINE,
            [*hosts_at("q1", "q3", "q5"), *pairwise(LINE)],
            [["alice", "charlie", "bob", "ed"], LINE],
        ),
        (
            LINE,
            [*hosts_at("q1", "q2", "q3"), *RING],
            [["alice", "charlie", "bob", "ed"], ["q1", "q2", "q3"], ["q5", "q4"]],
        ),
        (
            ["q1", "q2", "q3", "q4", "q5", "q6", "q7"],
            [*hosts_at("q1", "q2", "q4"), *STAGES],
            [["alice", "charlie", "bob", "ed"], ["q1", "q2", "q3", "q4"], ["q5", "q6", "q7"]],
        ),
        (
            ["q1", "q2", "q3"],  # charlie and bob are repeaters
            [(host, at) for host, *places in CHAIN for at in places],
            [["alice", "charlie", "bob", "ed"], ["q1", "q2", "q3"]],
        ),
    ],
    ids=["one switch", "line", "ring", "two stages", "repeaters"],
)
def test_fibres_lead_to_the_right_or_to_a_neighbour(
    switches: list[str], joined: list[tuple[str, str]], expected: list[list[str]]
) -> None:
    assert columns(network(switches, joined)) == [["s1"], *expected]


def test_fibres_that_are_alike_share_a_label_and_each_path_has_its_colour() -> None:
    facts = network(["q1"], hosts_at("q1", "q1", "q1"))
    first, second, third, _fourth = facts.fibers
    paths = [
        LightPath("alice-q0", "bob-q0", (Hop(fiber_name(first), 1), Hop(fiber_name(second), 1))),
        LightPath("alice-q0", "bob-q1", (Hop(fiber_name(first), 1), Hop(fiber_name(third), 1))),
    ]
    drawn = network_diagram(facts, paths)
    labels = re.findall(r"<text[^>]*>([^<]* dB)</text>", drawn)
    assert sorted(labels) == ["2 km, 0.4 dB", "2 km, 0.4 dB", "2 × 2 km, 0.4 dB"]  # noqa: RUF001
    strokes = re.findall(r"stroke: var\(--([a-z0-9-]+)\); stroke-width: 2.4", drawn)
    assert strokes == ["quantum", "path-1", "quantum", "path-1"]


def test_fibres_that_somebody_measures_are_marked() -> None:
    """By hand: of five fibres one is tapped, one was, and one is of the host that resends."""
    facts = network(["q1"], [*hosts_at("q1", "q1", "q1"), ("ed", "q1")])
    tapped, once, *_others, last = facts.fibers
    taps = [(tapped.b, 0.2), (once.a, 0.3), (once.a, 0)]
    events = [
        Event(kind="tune", node=end.node, port=end.port, detail=f"tapped {share:g}")
        for end, share in taps
    ]
    eve = eavesdropped(facts, [*events[:2], Event(kind="resend", node="ed")])
    shares = {fiber_name(tapped): "0.2", fiber_name(once): "0.3", fiber_name(last): ""}
    assert eve.nodes == {"ed"}
    assert eve.fibers == shares
    assert eavesdropped(facts, events) == eavesdropped(facts, events[:2])  # at any time
    drawn = network_diagram(facts, [], eve)
    strokes = re.findall(r"stroke: var\(--bad\); stroke-width: ([0-9.]+)", drawn)
    assert strokes == ["6", "6", "6", "1.4"]  # three fibres, and the box of ed
    assert "var(--bad)" not in network_diagram(facts, [])


@pytest.mark.parametrize(
    ("switches", "joined"),
    [
        (["q1"], hosts_at("q1", "q1", "q1")),
        (["q1", "q2"], [*hosts_at("q1", "q1", "q2"), *[("q1", "q2")] * 2]),
        (LINE, [*hosts_at("q1", "q3", "q5"), *pairwise(LINE)]),
        (LINE[:4], [*hosts_at("q1", "q2", "q3"), *[*pairwise(LINE[:4]), ("q4", "q1")] * 2]),
        (LINE, [*hosts_at("q1", "q2", "q3"), *[*pairwise(LINE), ("q5", "q1")] * 2]),
        (LINE, [*hosts_at("q1", "q2", "q3"), *product(LINE[:3], LINE[3:])]),
    ],
    ids=["one switch", "two switches", "line", "ring of four", "ring of five", "two stages"],
)
def test_every_fibre_of_a_usual_network_has_a_label(
    switches: list[str], joined: list[tuple[str, str]]
) -> None:
    drawn = network_diagram(network(switches, joined), [])
    labels = re.findall(r"<text[^>]*>(?:([0-9]+) × )?2 km, 0.4 dB</text>", drawn)  # noqa: RUF001
    assert sum(int(count or 1) for count in labels) == len(joined)


@pytest.mark.nightly
def test_a_crowded_network_names_the_fibres_that_light_took() -> None:
    leaves, spines = [f"q{n}" for n in range(1, 13)], [f"q{n}" for n in range(13, 21)]
    stages = [(leaf, spine) for leaf in leaves for spine in spines]
    facts = network([*leaves, *spines], [*hosts_at("q1", "q6", "q12"), *stages])
    used = facts.fibers[-3:] = [replace(fiber, length_km=3.0) for fiber in facts.fibers[-3:]]
    paths = [LightPath("a", "b", tuple(Hop(fiber_name(fiber), 0.6) for fiber in used))]
    drawn = network_diagram(facts, paths)
    assert drawn.count("3 km, 0.6 dB") == 3
    assert drawn.count("2 km, 0.4 dB") < 0.75 * len(stages)


def test_a_network_with_positions_is_drawn_as_its_map() -> None:
    """Rome is east and south of Genoa: its box is to the right of and below that one."""
    facts = replace(
        network(["q1", "q2"], [("q1", "q2"), ("alice", "q1"), ("bob", "q2")]),
        positions={"q1": (8.93, 44.41), "q2": (12.48, 41.89)},
    )
    nodes = of_nodes(facts)
    assert (nodes["alice"], nodes["bob"]) == (facts.positions["q1"], facts.positions["q2"])
    assert "ed" not in nodes
    genoa, rome = on_paper([facts.positions["q1"], facts.positions["q2"]])
    assert genoa[0] < rome[0]
    assert genoa[1] < rome[1]
    drawn = map_diagram(facts, [])
    assert [
        text for text in ("alice", "bob", "q1", "q2", "2 km, 0.4 dB") if text not in drawn
    ] == []
    assert "charlie" not in drawn


@pytest.mark.parametrize("name", ["abilene", "nobel-germany", "garr"])
def test_no_two_places_of_a_map_are_drawn_over_each_other(name: str) -> None:
    places = on_paper(sorted({each.position for each in read_map(name).places if each.position}))
    width, height = NODE_INCHES
    for one, two in combinations(places, 2):
        assert abs(one[0] - two[0]) > width or abs(one[1] - two[1]) > height
    assert all(width / 2 < x < WIDTH_INCHES - width / 2 and y > height / 2 for x, y in places)


def test_a_box_names_what_it_has_room_for() -> None:
    assert in_a_line(["q1", "q22"]) == "q1, q22"
    assert in_a_line(["mi1", "mi2", "mi4", "co", "q11", "q26", "q28"]) == "mi1, mi2, 5 more"
