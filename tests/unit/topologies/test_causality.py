"""News that could outrun light is found, with the worst case."""

from collections.abc import Iterator

import pytest

from programs.shortest_paths import Distances, shortest
from topologies.links import causality
from topologies.links.causality import ways_of_news, worst
from topologies.links.copper_link import delay_s
from topologies.system.runs.runtime import Runtime
from wire.config import QuantumSwitch
from wire.parameters.fiber import Fiber, FiberEnd

LIGHT_KM_PER_S = 2.04e5


@pytest.fixture
def network() -> Iterator[Runtime]:
    """alice -- 300 km -- q1 -- 100 km -- bob, and s1 with the copper of both."""
    made = Runtime()
    made.addresses |= {"alice": "10.0.0.1", "bob": "10.0.0.2"}
    made.switches["q1"] = QuantumSwitch("q1")
    made.fibers.append(Fiber(FiberEnd("alice", "a"), FiberEnd("q1", "1"), length_km=300.0))
    made.fibers.append(Fiber(FiberEnd("q1", "2"), FiberEnd("bob", "b"), length_km=100.0))
    yield made
    made.remove()


def lay(network: Runtime, **kilometres: float) -> None:
    for host, length_km in kilometres.items():
        network.copper[frozenset((host, "s1"))] = delay_s(length_km)


def test_copper_beside_its_fibres_outruns_nothing(network: Runtime) -> None:
    lay(network, alice=300.0, bob=100.0, q1=0.0)
    assert worst(network) is None


def test_the_worst_of_several_is_named(network: Runtime) -> None:
    """100 km too short between the hosts, 290 to q1, whose copper to s1 is short."""
    lay(network, alice=10.0, bob=290.0, q1=0.0)
    found = worst(network)
    assert found is not None
    assert (found.origin, found.receiver) == ("alice", "q1")
    assert found.early_s == pytest.approx(290.0 / LIGHT_KM_PER_S)


def test_what_any_packet_takes_anyhow_is_not_early(network: Runtime) -> None:
    """One km is 4.9 us, and a packet takes 10 us here; a hundred times as slow, it is early."""
    lay(network, alice=299.0, bob=100.0, q1=0.0)
    assert worst(network) is None
    network.time_scale = 100.0
    network.__post_init__()
    found = worst(network)
    assert found is not None
    assert found.early_s == pytest.approx(1.0 / LIGHT_KM_PER_S)


def test_a_controller_may_tell_a_switch_before_light_does(network: Runtime) -> None:
    """Copper from s1 to s2 is as long as light needs; the controller is at both at once."""
    lay(network, alice=300.0)
    network.copper[frozenset(("s1", "s2"))] = delay_s(200.0)
    network.copper[frozenset(("bob", "s2"))] = delay_s(0.0)
    assert worst(network) is None
    for switch in ("s1", "s2"):
        network.copper[frozenset(("c0", switch))] = delay_s(0.0)
    found = worst(network)
    assert found is not None
    assert {found.origin, found.receiver} == {"alice", "bob"}
    assert found.early_s == pytest.approx(100.0 / LIGHT_KM_PER_S)


def test_news_takes_the_fastest_way_there_is(network: Runtime) -> None:
    lay(network, alice=300.0, bob=100.0)
    for one, other in (("alice", "bob"), ("bob", "alice")):
        report = shortest(ways_of_news(network), one)
        assert report[other] == pytest.approx(400.0 / LIGHT_KM_PER_S)


def test_ways_are_sought_twice_for_each_host_and_not_for_each_two(
    network: Runtime, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With a thousand hosts, there are half a million times two of them."""
    hosts = [f"h{number}" for number in range(30)]
    for host in hosts:
        network.fibers.append(Fiber(FiberEnd(host, "a"), FiberEnd("q1", host), length_km=1.0))
        lay(network, **{host: 1.0})
    sought: list[str] = []

    def counted(ways: Distances, start: str) -> dict[str, float]:
        sought.append(start)
        return shortest(ways, start)

    monkeypatch.setattr(causality, "shortest", counted)
    assert worst(network) is None
    assert sorted(sought) == sorted(2 * [*hosts, "alice", "bob"])
