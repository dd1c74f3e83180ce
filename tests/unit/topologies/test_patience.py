"""How long a bridge waits for the controller: for a far one, and for one that has much to do."""

from collections.abc import Iterator

import pytest

from topologies.nodes.classical_switch import ClassicalSwitch
from topologies.system.runs.runtime import Runtime

PROBE_MS = 5_000  # Open vSwitch's own (ovs-vswitchd.conf.db(5), inactivity_probe)


@pytest.fixture
def switch() -> Iterator[ClassicalSwitch]:
    """Give s1 of a network that is not started."""
    made = ClassicalSwitch.__new__(ClassicalSwitch)
    made.name, made.network = "s1", Runtime()
    yield made
    made.network.remove()


def test_a_small_network_leaves_the_probe_to_open_vswitch(switch: ClassicalSwitch) -> None:
    switch.network.addresses |= {f"h{number}": "" for number in range(100)}
    assert switch._patience("c0") == {"max_backoff": 1_000}


def test_a_large_network_waits_longer_for_its_controller(switch: ClassicalSwitch) -> None:
    """A thousand hosts keep it for more than ten seconds when they come."""
    switch.network.addresses |= {f"h{number}": "" for number in range(1_024)}
    settings = switch._patience("c0")
    assert settings["max_backoff"] == 1_000
    assert settings["inactivity_probe"] > 2 * PROBE_MS


def test_where_time_is_stepped_a_slow_machine_loses_no_switch(switch: ClassicalSwitch) -> None:
    switch.network.remove()
    switch.network = Runtime(stepped=True)
    assert switch._patience("c0")["inactivity_probe"] > 10_000 * PROBE_MS


def test_a_far_controller_is_waited_for_longer_than_there_and_back(switch: ClassicalSwitch) -> None:
    switch.network.copper[frozenset(("c0", "s1"))] = 2.0
    assert switch._patience("c0")["inactivity_probe"] > 2 * 2_000
