"""Light paths against networkx's shortest paths, and a queue that is served when light is freed."""

from itertools import islice, pairwise
from random import Random

import networkx
import pytest
from metadata_scene import frame

from controller_apps.light.optics import SwitchOptics, SwitchPort
from controller_apps.light.paths import Direction, HostPort, Network, directions
from controller_apps.light.routing import Leg, Limits, bounds_to, cheapest_path
from controller_apps.light.waypoints import path_over
from controller_apps.sessions.actions import Action, Note, OpenPaths
from controller_apps.sessions.admission import find_light
from controller_apps.sessions.arbiter import Arbiter
from wire.metadata.setup import SETUP_LENGTH, Setup
from wire.metadata.vocabulary import Handshake, Service
from wire.optical import ALL_VALID, ANY_PORT, PathOptics, PortLight

CHANNEL_MHZ = 193_400_000
S1, SWITCHES = 100, 12


def light(rx_power: int) -> PortLight:
    return PortLight(ALL_VALID, CHANNEL_MHZ, 0, 0, CHANNEL_MHZ, 0, 0, 0, rx_power, 0, 250)


def address(dpid: int) -> str:
    return f"10.0.0.{dpid}"


def random_network(random: Random) -> tuple[Network, networkx.Graph]:
    """Return switches with a host of two fibres each, and the same as a graph of losses (mdB)."""
    network, graph = Network(set(range(1, SWITCHES + 1))), networkx.DiGraph()
    loss = {dpid: random.randrange(0, 3_000) for dpid in network.connected}
    for dpid in network.connected:
        network.optics.take(dpid, SwitchOptics(PathOptics(ANY_PORT, ANY_PORT, loss[dpid], 0)))
        for port in (1, 2):
            host = HostPort(f"h{dpid}", address(dpid), f"h{dpid}-q{port}")
            network.attach(SwitchPort(dpid, port), host)
    one_by_one = [(n, n + 1) for n in range(1, SWITCHES)]
    more = [random.sample(range(1, SWITCHES + 1), 2) for _ in range(SWITCHES)]
    for number, (one, other) in enumerate([*one_by_one, *more]):
        ends = SwitchPort(one, 10 + number), SwitchPort(other, 10 + number)
        network.add_link(*ends)
        lost = random.randrange(0, 60)
        for near, far in (ends, ends[::-1]):
            network.optics.measured(near, light(-lost))
            weight = loss[near.dpid] + 100 * lost
            known = graph.get_edge_data(near.dpid, far.dpid, {"weight": weight})["weight"]
            graph.add_edge(near.dpid, far.dpid, weight=min(weight, known))
    for dpid in network.connected:
        graph.add_edge(dpid, f"end of {dpid}", weight=loss[dpid])
    return network, graph


@pytest.mark.by_day(every=2)
@pytest.mark.parametrize("seed", range(20))
def test_the_path_of_least_loss_is_that_of_networkx(seed: int) -> None:
    random = Random(seed)
    network, graph = random_network(random)
    for _ in range(10):
        one, other = random.sample(range(1, SWITCHES + 1), 2)
        leg = Leg(SwitchPort(one, 1), SwitchPort(other, 2))
        found = cheapest_path(network, leg, Limits())
        assert found is not None
        assert found.leg == leg
        assert found.loss_mdb == networkx.dijkstra_path_length(graph, one, f"end of {other}")


@pytest.mark.by_day(every=2)
@pytest.mark.parametrize("seed", range(20))
def test_where_others_have_fibres_the_path_is_that_of_networkx_over_the_rest(seed: int) -> None:
    random = Random(seed)
    network, graph = random_network(random)
    other_ways = 0
    for _ in range(10):
        one, other = random.sample(range(1, SWITCHES + 1), 2)
        leg = Leg(SwitchPort(one, 1), SwitchPort(other, 2))
        best = cheapest_path(network, leg, Limits())
        near = random.sample(sorted(network.links), len(network.links) // 4)
        taken = {Direction(*at, False) for at in near}
        rest = networkx.DiGraph()
        rest.add_edges_from(edge for edge in graph.edges(data=True) if isinstance(edge[1], str))
        for at, far in network.links.items():
            if at in near:
                continue
            first = graph.edges[at.dpid, f"end of {at.dpid}"]["weight"]
            weight = first + network.optics.fiber_loss_mdb(at, far)
            known = rest.get_edge_data(at.dpid, far.dpid, {"weight": weight})["weight"]
            rest.add_edge(at.dpid, far.dpid, weight=min(weight, known))
        found = cheapest_path(network, leg, Limits(taken.__contains__))
        end = f"end of {other}"
        if found is None:
            assert one not in rest or not networkx.has_path(rest, one, end)
            continue
        assert taken.isdisjoint(directions(found.hops))
        assert found.loss_mdb == networkx.dijkstra_path_length(rest, one, end)
        other_ways += found != best
        assert cheapest_path(network, leg, Limits()) == best
    assert other_ways


def ways_over(graph: networkx.Graph, one: int, other: int, over: set[int]) -> list[float]:
    """Return what light loses by each way that crosses a fibre, by enumeration."""
    ways = networkx.all_simple_paths(graph, one, f"end of {other}")
    crossing = (way for way in ways if any({*pair} == over for pair in pairwise(way)))
    return [networkx.path_weight(graph, way, "weight") for way in crossing]


@pytest.mark.parametrize("seed", range(10))
def test_a_path_over_a_fibre_is_one_of_all_that_there_are_and_mostly_the_best(seed: int) -> None:
    random = Random(seed)
    network, graph = random_network(random)
    network.names = {dpid: f"q{dpid}" for dpid in network.connected}
    best = there = 0
    for _ in range(10):
        one, other = random.sample(range(1, SWITCHES + 1), 2)
        over = {at.dpid for at in random.choice(list(network.links.items()))}
        leg, names = Leg(SwitchPort(one, 1), SwitchPort(other, 2)), frozenset(f"q{n}" for n in over)
        wanted = ways_over(graph, one, other, over)
        there += bool(wanted)
        found = path_over(network, leg, names, Limits())
        if found is None:
            continue
        passed = [hop.dpid for hop in found.hops]
        assert found.leg == leg
        assert len(set(passed)) == len(passed)
        assert any({*pair} == over for pair in pairwise(passed))
        assert found.loss_mdb in wanted
        best += found.loss_mdb == min(wanted)
        within = Limits(loss_budget_mdb=found.loss_mdb)
        assert path_over(network, leg, names, within) == found
        too_little = Limits(loss_budget_mdb=int(min(wanted)) - 1)
        assert path_over(network, leg, names, too_little) is None
    assert there > 0
    assert best >= there / 2


@pytest.mark.parametrize("seed", range(5))
def test_a_path_round_what_is_taken_is_that_of_networkx_without_it(seed: int) -> None:
    """Fibres of one direction are taken, so that bounds no longer are what the path loses."""
    random = Random(seed)
    network, graph = random_network(random)
    taken = {tuple(random.sample(range(1, SWITCHES + 1), 2)) for _ in range(40)}
    graph.remove_edges_from(taken)
    ways = {(near, far) for near, far in network.links.items() if (near.dpid, far.dpid) in taken}
    blocked = {(*near, False) for near, _far in ways}
    limits = Limits(lambda way: way in blocked)
    for one in range(1, SWITCHES):
        found = cheapest_path(network, Leg(SwitchPort(one, 1), SwitchPort(SWITCHES, 2)), limits)
        end = f"end of {SWITCHES}"
        if not networkx.has_path(graph, one, end):
            assert found is None
            continue
        assert found is not None
        assert found.loss_mdb == networkx.dijkstra_path_length(graph, one, end)


def test_bounds_follow_losses_and_links() -> None:
    network, _graph = random_network(Random(1))
    end = SwitchPort(SWITCHES, 2)
    before = dict(bounds_to(end, network))
    assert bounds_to(end, network) is bounds_to(end, network)
    network.optics.measured(end, light(-500))
    assert bounds_to(end, network) != before
    for at in list(network.links):
        network.remove_link(at)
    assert bounds_to(end, network).keys() == {SWITCHES} < before.keys()


def test_whoever_waits_has_no_light_after_any_event() -> None:
    """Few of those that wait are looked at; the search for each of them says that this is enough.

    Sessions come and go at random, and now and then a fibre is cut or mended.
    """
    random = Random(1)
    network, _graph = random_network(random)
    state = Arbiter(network, 1e9, 1e9, 60.0, queues=True)
    lit: dict[int, tuple[str, str]] = {}
    asked: dict[int, tuple[str, str]] = {}

    def obey(actions: list[Action]) -> None:
        for action in actions:
            if isinstance(action, OpenPaths):
                obey(state.barrier_passed(action.dpid, action.transaction, 0.0))
            elif isinstance(action, Note) and action.event == "path_ready":
                lit[action.session] = asked[action.session]

    def say(number: int, seq: int, flags: str, payload: bytes = b"") -> None:
        source, destination = asked[number]
        ends = {"source": source, "destination": destination, "sport": 1024 + number}
        obey(state.segment_arrived(S1, 1, segment(payload, seq, flags, **ends), 0.0))

    waited = 0
    for number in range(1, 110):
        one, other = random.sample(range(1, SWITCHES + 1), 2)
        asked[number] = address(one), address(other)
        setup = Setup(number, Service["BB84"], Handshake.FRAMED, address(one), 64, 1, 1)
        say(number, 100, "PA", setup.encode())
        if number > 30:
            ended = random.choice(sorted(lit))
            del lit[ended]
            say(ended, 100 + SETUP_LENGTH, "FA")
        if number % 10 == 0:
            at = random.choice(sorted(network.links))
            ends = at, network.links[at]
            for end in ends:
                network.set_fiber(end, whole=False)
            obey(state.network_changed(0.0))
        waiting = list(state.sessions.queue.values())
        waited += len(waiting)
        for request in islice(waiting, 20):
            found = find_light(
                request.setup, request.five_tuple, state.sessions, network, state.terms.budget_mdb
            )
            assert found.waits_for_light
            assert not found.paths
    assert waited > 500  # else nothing was shown


def segment(payload: bytes, seq: int, flags: str, **ends: object) -> bytes:
    return frame(payload, seq=seq, flags=flags, **ends)  # type: ignore[arg-type]
