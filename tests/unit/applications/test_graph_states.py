"""Graph states between whole stacks over loopback, beside an enumeration with stim's tableaus."""

from itertools import pairwise, product
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import stim
from line_scene import LINE, MEMORIES, five_t2_late, summaries

from applications.graph_states.graph import Graph, graph_of_numbers, numbers_of_graph, read_graph
from applications.graph_states.options import GraphOptions
from applications.graph_states.witness import Colours, Stabilisers
from hosts.middleware.session.errors import SessionError
from wire.parameters.physics import Detectors, Device, Memory

COUNT = 20_000
GRAPHS = [
    (3, "line"),
    (3, "ring"),
    (3, "charlie-alice,charlie-bob"),
    (4, "ring"),
    (4, "star"),
    (4, "complete"),
]
HUB = (
    4,
    "bob-alice,bob-charlie,bob-eve",
    "bob",
)  # a star, of which the others are left in a GHZ state
PENTAGON = ((0, 1), (1, 2), (2, 3), (3, 4), (0, 4))
WHEEL = (*PENTAGON, *((place, 5) for place in range(5)))


def fidelity(graph: Graph, kept: float) -> float:
    """Return the mean of all stabilisers, where each link of an edge keeps so much of its pair.

    A pair that is depolarised is a graph state of two with Z at either end, each in half of the
    cases in which it is hit; a product of generators changes its sign unless it has neither end.
    Z at a hub is Z at all its neighbours: it is in products with an odd number of them.
    """
    found = []
    for some in product((0, 1), repeat=len(graph.members)):
        chosen = dict(zip(graph.members, some, strict=True))
        if graph.hub:
            chosen[graph.hub] = sum(chosen[place] for place in graph.neighbours(graph.hub)) % 2
        found.append([kept ** (b - a) for a, b in graph.edges if chosen[a] or chosen[b]])
    return float(np.mean([np.prod(each) for each in found]))


def is_made(graph: Graph, errors: dict[tuple[int, int, int], int]) -> bool:
    """Return whether pairs with these errors become the graph state, by a circuit of its own.

    The errors (0 I, 1 X, 2 Y, 3 Z) are of the right half of the pair of an edge on a link. Qubits
    are numbered as they are made. An edge's pairs are swapped, and its right end goes through H;
    of all ends at a host the others are measured into the first one. A hub is measured in Y.
    """
    simulator, qubits = stim.TableauSimulator(seed=1), iter(range(1000))
    ends: dict[int, list[tuple[int, int]]] = {place: [] for place in range(graph.hosts)}
    flips = [0] * graph.hosts
    for a, b in graph.edges:
        pairs = [(next(qubits), next(qubits)) for _link in range(a, b)]
        for link, (left, right) in enumerate(pairs, a):
            simulator.h(left)
            simulator.cx(left, right)
            (lambda *_: None, simulator.x, simulator.y, simulator.z)[errors[a, b, link]](right)
        for (_left, came), (own, _right) in pairwise(pairs):
            simulator.cx(came, own)
            flips[b] ^= simulator.measure(own)
            simulator.h(came)
            flips[a] ^= simulator.measure(came)
        simulator.h(pairs[-1][1])
        ends[a].append((pairs[0][0], b))
        ends[b].append((pairs[-1][1], a))
    for (first, _far), *others in ends.values():
        for qubit, far in others:
            simulator.cx(first, qubit)
            flips[far] ^= simulator.measure(qubit)
    kept = [found[0][0] for found in ends.values()]
    for qubit, flip in zip(kept, flips, strict=True):
        if flip:
            simulator.z(qubit)
    if graph.hub:
        simulator.h_yz(kept[graph.hub])
        outcome = simulator.measure(kept.pop(graph.hub))
        for place in graph.neighbours(graph.hub):
            qubit = kept[graph.members.index(place)]
            (simulator.s if outcome else simulator.s_dag)(qubit)
    rest = graph.left()
    return all(
        simulator.peek_observable_expectation(generator(rest, place, kept)) == 1
        for place in range(rest.hosts)
    )


def generator(graph: Graph, place: int, kept: list[int]) -> stim.PauliString:
    """Return X at a host and Z at its neighbours."""
    paulis = stim.PauliString(max(kept) + 1)
    paulis[kept[place]] = "X"
    for a, b in graph.edges:
        if place in (a, b):
            paulis[kept[b if place == a else a]] = "Z"
    return paulis


@pytest.mark.parametrize(
    ("hosts", "words", "hub"),
    [*((*graph, "") for graph in GRAPHS[:3]), (3, "line", "bob"), (4, "line", "charlie"), HUB],
)
def test_the_closed_form_is_that_of_an_enumeration_of_all_errors(
    hosts: int, words: str, hub: str
) -> None:
    graph, p = read_graph(words, LINE[:hosts], hub), 0.1
    links = [(a, b, link) for a, b in graph.edges for link in range(a, b)]
    total = 0.0
    for errors in product(range(4), repeat=len(links)):
        share = float(np.prod([p / 4 if error else 1 - 3 * p / 4 for error in errors]))
        total += share * is_made(graph, dict(zip(links, errors, strict=True)))
    assert fidelity(graph, 1 - p) == pytest.approx(total)


def made(folder: Path, hosts: int, words: str, **given: Any) -> list[dict[str, Any]]:
    """Return the summaries of all hosts, in their order."""
    asked: dict[str, Any] = {
        name: given.pop(name) for name in ("count", "witness", "hub") if name in given
    }
    return summaries(folder, "graph", LINE[:hosts], {"graph": words, **asked}, **given)


@pytest.mark.parametrize(("hosts", "words"), GRAPHS)
def test_states_over_perfect_fibers_are_graph_states(
    tmp_path: Path, hosts: int, words: str
) -> None:
    alice, *others = made(tmp_path, hosts, words, count=1000)
    assert (alice["fidelity"], alice["states"], alice["emitted"]) == (1, 1000, 1000)
    assert [each["states"] for each in others] == [1000] * (hosts - 1)


@pytest.mark.by_day(every=2)
@pytest.mark.parametrize(("hosts", "words"), GRAPHS)
def test_fibers_that_depolarise_leave_the_fidelity_of_the_closed_form(
    tmp_path: Path, hosts: int, words: str
) -> None:
    alice, *_others = made(tmp_path, hosts, words, count=COUNT, depolarizing=0.03)
    expected = fidelity(read_graph(words, LINE[:hosts]), 0.97**2)  # to the switch, to the host
    assert abs(alice["fidelity"] - expected) < 5 * alice["fidelity_error"] < 0.03


def test_a_hub_fuses_pairs_and_leaves_the_others_joined(tmp_path: Path) -> None:
    """Of a star each two of the others: the triangle, which is a GHZ state but for local gates."""
    hosts, words, hub = HUB
    alice, bob, *_others = made(tmp_path, hosts, words, hub=hub, count=COUNT, depolarizing=0.03)
    expected = fidelity(read_graph(words, LINE, hub), 0.97**2)
    assert (alice["edges"], alice["pairs_per_state"]) == (3, 4)
    assert bob["fused"] >= alice["made"]
    assert abs(alice["fidelity"] - expected) < 5 * alice["fidelity_error"] < 0.03


def test_what_a_hub_leaves_is_the_local_complement() -> None:
    assert read_graph(HUB[1], LINE, "bob").left() == read_graph("complete", LINE[:3])
    assert read_graph("complete", LINE, "bob").hub == 1
    assert read_graph("line", LINE[:3], "bob").left().edges == ((0, 1),)


@pytest.mark.parametrize(("words", "colours"), [("ring", 2), ("complete", 4)])
def test_a_few_settings_bound_the_fidelity_from_below(
    tmp_path: Path, words: str, colours: int
) -> None:
    """All generators of a colour are +1 with the mean of their products."""
    given: dict[str, Any] = {"count": COUNT, "witness": "colours"}
    alice, *_others = made(tmp_path, 4, words, **given, depolarizing=0.02)
    graph = read_graph(words, LINE)
    passed = [
        np.mean(
            [
                np.prod([0.98 ** (2 * (b - a)) for a, b in graph.edges if {a, b} & set(chosen)])
                for chosen in subsets([place for place in range(4) if graph.colours[place] == each])
            ]
        )
        for each in range(colours)
    ]
    assert len(alice["passed"]) == colours
    bound = alice["fidelity_at_least"]
    assert abs(bound - (sum(passed) - colours + 1)) < 5 * alice["fidelity_error"] < 0.05
    assert bound < fidelity(graph, 0.98**2)


def subsets(places: list[int]) -> list[list[int]]:
    """Return all choices of hosts."""
    return [
        [place for place, chosen in zip(places, choice, strict=True) if chosen]
        for choice in product((0, 1), repeat=len(places))
    ]


def test_light_that_is_lost_costs_states_and_no_fidelity(tmp_path: Path) -> None:
    """Of each of four pairs one half passes two fibres of 10 m."""
    alice, *_others = made(tmp_path, 3, "ring", count=1500, loss_db_per_km=50.0)
    assert alice["fidelity"] == 1
    share, arrives = alice["made"] / alice["emitted"], 10 ** (-4 * 2 * 0.5 / 10)
    assert abs(share - arrives) < 5 * np.sqrt(arrives * (1 - arrives) / alice["emitted"])


def test_where_a_fusion_is_not_seen_there_is_no_state(tmp_path: Path) -> None:
    """Bob swaps one pair and fuses two halves: three detections, each with the efficiency."""
    devices = {"bob": Device(detectors=Detectors(efficiency=0.7))}
    alice, bob, charlie = made(tmp_path, 3, "ring", count=1000, devices=devices)
    assert alice["fidelity"] == 1
    assert bob["states"] == charlie["states"] == alice["made"]
    share = alice["made"] / alice["emitted"]
    assert abs(share - 0.343) < 5 * np.sqrt(0.343 * 0.657 / alice["emitted"])


def test_blocks_are_as_small_as_the_halves_of_their_states_need(tmp_path: Path) -> None:
    """Of a ring bob and charlie keep four halves of each state: so two states fill eight places."""
    devices = dict.fromkeys(LINE[1:3], Device(memory=Memory(capacity=8)))
    alice, *_others = made(tmp_path, 4, "ring", count=6, devices=devices)
    assert (alice["states"], alice["fidelity"]) == (6, 1)


def test_qubits_wait_in_memory_until_they_are_used(tmp_path: Path) -> None:
    """Bob and charlie hear the bases 5 T2 late: X at alice, Z at bob is all that stays."""
    late = {"devices": MEMORIES, "change": five_t2_late}
    alice, *_others = made(tmp_path, 3, "line", count=4000, **late)
    assert abs(alice["fidelity"] - 2 / 8) < 5 * alice["fidelity_error"] < 0.1


@pytest.mark.parametrize(
    ("words", "hub", "text"),
    [
        ("line", "alice", "hub alice: choose one of bob, charlie"),
        ("complete", "bob", "without bob: no edges lead"),
        ("alice-bob", "", "no edges lead from the first host to number 3"),
        ("alice-bob,bob-zoe", "", "'bob-zoe' is not an edge between two of alice, bob, charlie"),
        ("alice-bob,bob-alice,bob-charlie", "", "an edge occurs twice: name each edge once"),
        ("pentagram", "", "write line, ring, star, complete, or edges as A-B,B-C"),
    ],
)
def test_a_graph_that_cannot_be_is_refused(words: str, hub: str, text: str) -> None:
    options = GraphOptions("bob", 9, graph=words, hub=hub)
    with pytest.raises(SessionError, match=text):
        options.check()


def test_names_with_hyphens_have_edges() -> None:
    assert read_graph("a-b-a", ["a", "b-a"]).edges == ((0, 1),)


@pytest.mark.parametrize(
    "numbers",
    [[1, 0], [17, 0, 0, 1], [3, 0, 0], [3, 0, 0, 1], [2, 0, 1, 0], [2, 0, 0, 2], [2, 2, 0, 1]],
)
def test_numbers_that_tell_no_graph_are_refused(numbers: list[int]) -> None:
    with pytest.raises(ValueError, match=r"host|edge"):
        graph_of_numbers(numbers)


def test_a_graph_is_told_whole() -> None:
    graph = Graph(6, WHEEL, 3)
    assert graph_of_numbers(numbers_of_graph(graph)) == graph


def test_edges_take_as_few_layers_of_pairs_as_the_busiest_link_has_edges() -> None:
    ring = read_graph("ring", LINE)
    assert (len(ring.layers), ring.pairs, ring.kept(0), ring.kept(1)) == (2, 6, 2, 4)
    complete = read_graph("complete", LINE)
    assert (len(complete.layers), complete.pairs) == (4, 10)  # between bob and charlie all but two
    assert len(read_graph("line", LINE).layers) == 1


@pytest.mark.parametrize(("edges", "hosts", "colours"), [(PENTAGON, 5, 3), (WHEEL, 6, 4)])
def test_neighbours_have_different_colours(
    edges: tuple[tuple[int, int], ...], hosts: int, colours: int
) -> None:
    graph = Graph(hosts, edges)
    assert all(graph.colours[a] != graph.colours[b] for a, b in edges)
    assert set(graph.colours) == set(range(colours))
    assert set(read_graph("star", LINE).colours) == {0, 1}


@pytest.mark.parametrize("witness", [Stabilisers, Colours])
@pytest.mark.parametrize(("edges", "hosts"), [(PENTAGON, 5), (WHEEL, 6), (((0, 2), (1, 2)), 3)])
@pytest.mark.parametrize("flipped", [False, True])
def test_a_witness_knows_graph_states_of_stim(
    witness: type[Stabilisers] | type[Colours],
    edges: tuple[tuple[int, int], ...],
    hosts: int,
    flipped: bool,
) -> None:
    """Fidelity 1; with Z at one host the state is orthogonal, and one colour is never right."""
    graph = Graph(hosts, edges)
    report, states = witness(graph), 2000
    bases = report.bases(np.random.default_rng(3), states)
    outcomes = np.array([measured(graph, own, flipped) for own in bases.T], dtype=np.uint8).T
    report.add(bases, outcomes)
    summary = report.summary()
    assert report.states == states
    if isinstance(report, Colours):
        assert sorted(summary["passed"])[0] == 1 - flipped
        assert summary["fidelity_at_least"] == pytest.approx(1 - flipped)
    else:
        assert abs(summary["fidelity"] - (1 - flipped)) <= 5 * summary["fidelity_error"]
        # Of outcomes that are all right, the half-width of Wilson's score interval of one sigma.
        alike = (1 - 0.5**hosts) / (states + 1)
        expected = 1 / np.sqrt(states) if flipped else alike
        assert summary["fidelity_error"] == pytest.approx(expected, rel=0.2)


def measured(graph: Graph, bases: np.ndarray[Any, Any], flipped: bool) -> list[bool]:
    """Return outcomes of a graph state, made of CZ; bases 0 Z, 1 X, 2 Y."""
    simulator = stim.TableauSimulator()
    simulator.h(*range(graph.hosts))
    simulator.cz(*(place for edge in graph.edges for place in edge))
    if flipped:
        simulator.z(1)
    for place, basis in enumerate(bases):
        if basis:
            (simulator.h if basis == 1 else simulator.h_yz)(place)
    return list(simulator.measure_many(*range(graph.hosts)))
