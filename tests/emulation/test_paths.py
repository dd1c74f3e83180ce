"""Light paths in the bridges: opened for a session, closed with it."""

import re
import subprocess

from conftest import wait_until

from hosts.quantum_socket import QuantumSocket
from topologies.network import Network


def flows(bridge: str) -> list[str]:
    """Return the entries of a bridge as ovs-ofctl prints them."""
    command = ["ovs-ofctl", "-O", "OpenFlow14", "dump-flows", bridge]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    return [line for line in done.stdout.splitlines() if "cookie" in line]


def light_paths() -> set[tuple[int, int]]:
    """Return (in_port, out_port) of the light entries of q1."""
    found = (
        re.search(r"in_port=\"?(?:q1-eth)?(\d+)\"? actions=\S*output:\"?(?:q1-eth)?(\d+)", line)
        for line in flows("q1")
    )
    return {(int(match[1]), int(match[2])) for match in found if match}


def port(network: Network, interface: str) -> int:
    """Return the port of q1 that a host's fibre ends in."""
    for fiber in network.runtime.fibers:
        if fiber.a.port == interface:
            return int(fiber.b.port)
    raise AssertionError(f"no fibre at {interface}")


def test_three_paths_stand_while_the_session_lasts(shared_network: Network) -> None:
    network = shared_network
    with QuantumSocket(network.runtime.socket("bob")) as listener:
        listener.listen(7)
        with QuantumSocket(network.runtime.socket("alice")) as sender:
            assert light_paths() == set()
            sender.connect(("bob", 7))
            alice, bob0, bob1, charlie0, charlie1 = (
                port(network, name)
                for name in ("alice-q0", "bob-q0", "bob-q1", "charlie-q0", "charlie-q1")
            )
            assert light_paths() == {(charlie0, alice), (alice, bob1), (charlie1, bob0)}
            receiver, peer = listener.accept()
            assert peer == "10.0.0.1"
            sender.sendall(b"over light")
            assert any("priority=300" in line and "tp_dst=9010" in line for line in flows("s1"))
            with receiver:
                assert receiver.recv(100) == b"over light"
        wait_until(lambda: not light_paths(), "the light paths are closed with the session")
        wait_until(
            lambda: not any("priority=300" in line for line in flows("s1")),
            "the bypass entry goes with the session",
        )


def test_metadata_is_punted_and_every_bridge_is_secure(shared_network: Network) -> None:
    assert any("tp_dst=9010" in line and "CONTROLLER" in line for line in flows("s1"))
    for bridge in ("s1", "q1"):
        command = ["ovs-vsctl", "get", "Bridge", bridge, "fail_mode"]
        assert subprocess.check_output(command, text=True).strip() == "secure"
        target = subprocess.check_output(["ovs-vsctl", "get-controller", bridge], text=True)
        assert target.startswith("tcp:127.0.0.1:")
    assert shared_network.net.pingAll(timeout="2") == 0


def test_ordinary_traffic_is_forwarded_by_learned_entries(shared_network: Network) -> None:
    network = shared_network
    alice, bob = network.host("alice"), network.host("bob")
    assert network.net.ping([alice, bob], timeout="2") == 0
    learned = [line for line in flows("s1") if "table=2" in line]
    for host in (alice, bob):
        assert any(f"dl_dst={host.MAC()}" in line for line in learned)
