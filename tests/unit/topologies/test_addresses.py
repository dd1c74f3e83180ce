"""Addresses beside those of the hosts."""

from topologies.nodes.addresses import broadcast, free_address


def test_the_broadcast_address_is_that_of_the_hosts_network() -> None:
    assert broadcast(["10.0.0.4", "10.0.0.1"], 24) == "10.0.0.255"
    assert broadcast(["10.0.0.4"], 8) == "10.255.255.255"


def test_the_controllers_address_is_no_hosts() -> None:
    assert free_address(["10.0.0.1"], 24) == "10.0.0.254"
    assert free_address(["10.0.0.1", "10.0.0.254", "10.0.0.253"], 24) == "10.0.0.252"
