"""The controller's own network: copper that can be long, lossy or cut."""

import json
import socket
from pathlib import Path

import pytest
from conftest import wait_until
from mininet.net import Mininet
from scapy.layers.inet import IP, TCP
from scapy.utils import rdpcap

from qmn.jobs.transfer import TransferError
from qmn.scripting import QuantumNetwork, start
from topologies.networks.network import Network
from wire.parameters.network import OPENFLOW_PORT

OPENFLOW_1_4 = b"\x05"
ONE_WAY_S = 2000e3 / 2.04e8


def test_the_controller_is_reached_over_its_own_copper_alone(tmp_path: Path) -> None:
    with start("sdc", folder=tmp_path) as network:
        c0 = network.net.get("c0")
        names = {line.split("@")[0].split()[0] for line in c0.cmd("ip -br link").splitlines()}
        assert {"c0-net", "c0-s1", "c0-q1"} <= names
        assert not names & {"s1", "s1-eth1", "q1"}
        require_patience(network)
        with pytest.raises(ConnectionRefusedError):
            socket.create_connection(("127.0.0.1", OPENFLOW_PORT), 5).close()
        capture = network.capture_openflow()
        assert network.send("alice", "bob", b"hello").data == b"hello"
    packets = [packet for packet in rdpcap(str(capture)) if TCP in packet]
    lines = [packet for packet in packets if bytes(packet[TCP].payload)[:1] == OPENFLOW_1_4]
    ends = {(packet[IP].src, packet[IP].dst) for packet in lines}
    for number in (1, 2):  # to and from both switches
        c0_address, switch = f"198.18.{number}.1", f"198.18.{number}.2"
        assert {(c0_address, switch), (switch, c0_address)} <= ends


def require_patience(network: QuantumNetwork) -> None:
    """Fail unless bridges wait a day of the wall for an echo of c0, by itself or by an agent.

    By itself Open vSwitch waits 5 s (ovs-vswitchd.conf.db(5), inactivity_probe): while the clock
    stands for longer on a busy machine, 48 switches leave c0, and sessions find no light.
    """
    words = "--bare", "--columns=inactivity_probe", "list", "Controller"
    probes = network.net.get("s1").vsctl(*words).split()
    assert probes == ["86400000", "86400000"]
    # tcp(7): after 5 a host resets a connection whose first data c0 still holds.
    retries = network.net.get("alice").cmd("cat /proc/sys/net/ipv4/tcp_synack_retries")
    assert int(retries) == 30


def test_a_quantum_switch_that_is_cut_off_gets_no_paths_until_it_is_back() -> None:
    """In paced time: in stepped time bob's ten seconds pass before c0 notices the cut."""
    with start("sdc", time="paced") as network:
        assert network.send("alice", "bob", b"one").data == b"one"
        network.net.configLinkStatus("c0", "q1", "down")
        with pytest.raises(TransferError, match="quantum switch"):
            network.send("alice", "bob", b"two")
        network.net.configLinkStatus("c0", "q1", "up")
        wait_until(lambda: arrives(network, b"three"), "light over q1 again")


def arrives(network: QuantumNetwork, data: bytes) -> bool:
    try:
        return network.send("alice", "bob", data).data == data
    except TransferError:
        return False


def test_paths_wait_for_the_way_to_the_controller_and_back(tmp_path: Path) -> None:
    with start("sdc", folder=tmp_path, control_km=2000.0) as network:
        network.send("alice", "bob", b"hello")
        lines = (tmp_path / "controller.jsonl").read_text().splitlines()
    (ready,) = (each for each in map(json.loads, lines) if each["event"] == "path_ready")
    assert ready["setup_ms"] / 1e3 >= 2 * ONE_WAY_S


@pytest.mark.nightly
def test_a_session_opens_over_a_lossy_way_to_the_controller() -> None:
    """A tenth of the packets is lost, either way; TCP sends them again."""
    with start("sdc", control_loss=0.1) as network:
        wait_until(lambda: arrives(network, b"hello"), "a session")


def require_no_ipv6(net: Mininet) -> None:
    interfaces = {name for switch in net.switches for name in switch.intfNames()} - {"lo"}
    assert {"s1-eth1", "q1-eth1"} <= interfaces
    lines = Path("/proc/net/if_inet6").read_text().splitlines()
    assert not interfaces & {line.split()[-1] for line in lines}


def test_no_interface_of_a_switch_has_an_ipv6_address(shared_network: Network) -> None:
    require_no_ipv6(shared_network.net)


def test_no_end_of_long_copper_has_an_ipv6_address() -> None:
    with start("sdc", copper_km=20.0) as network:
        require_no_ipv6(network.net)
