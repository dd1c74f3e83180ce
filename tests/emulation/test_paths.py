"""Light paths in the bridges: opened for a session, closed with it."""

import re
import stat
import subprocess
from pathlib import Path

import pytest
from conftest import wait_until
from limits import SOON_S

from hosts.quantum_socket import QuantumSocket
from topologies.networks.network import Network


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
    for bridge, kind in (("s1", "tcp:198.18."), ("q1", "unix:")):
        command = ["ovs-vsctl", "get", "Bridge", bridge, "fail_mode"]
        assert subprocess.check_output(command, text=True).strip() == "secure"
        target = subprocess.check_output(["ovs-vsctl", "get-controller", bridge], text=True)
        assert target.startswith(kind)
    assert shared_network.net.pingAll(timeout="2") == 0


def ofctl(*words: str) -> "subprocess.CompletedProcess[str]":
    """Run ovs-ofctl as a user of the network does."""
    command = ["ovs-ofctl", "-O", "OpenFlow14", *words]
    return subprocess.run(command, capture_output=True, text=True, timeout=SOON_S, check=False)


@pytest.mark.usefixtures("shared_network")
def test_ovs_ofctl_speaks_to_the_agent() -> None:
    refused = ofctl("add-flow", "q1", "priority=9,in_port=3,actions=output:4,output:5")
    assert "OFPBAC_TOO_MANY" in refused.stderr
    ports = ofctl("dump-ports", "q1", "2").stdout
    assert "bytes=?" in ports  # a counter that light does not have
    added = ofctl("add-flow", "q1", "priority=9,in_port=3,idle_timeout=50,actions=output:4")
    assert added.returncode == 0, added.stderr
    (entry,) = [line for line in flows("q1") if "priority=9" in line]
    assert "idle_timeout=50" in entry
    assert "note" not in entry
    assert ofctl("--strict", "del-flows", "q1", "priority=9,in_port=3").returncode == 0
    assert not [line for line in flows("q1") if "priority=9" in line]


def test_nobody_but_the_bridge_reaches_the_agents_port(shared_network: Network) -> None:
    network = shared_network.runtime
    target = subprocess.check_output(["ovs-vsctl", "get-controller", "q1"], text=True).strip()
    for path in (target.removeprefix("unix:"), "/var/run/openvswitch/q1.mgmt"):
        found = Path(path).stat()
        assert (found.st_uid, stat.S_IMODE(found.st_mode)) == (0, 0o600)
    assert Path(network.socket("q1-bridge")).is_socket()
    assert stat.S_IMODE(network.folder.stat().st_mode) == 0o700


def test_ordinary_traffic_is_forwarded_by_learned_entries(shared_network: Network) -> None:
    network = shared_network
    alice, bob = network.host("alice"), network.host("bob")
    assert network.net.ping([alice, bob], timeout="2") == 0
    learned = [line for line in flows("s1") if "table=2" in line]
    for host in (alice, bob):
        assert any(f"dl_dst={host.MAC()}" in line for line in learned)
