"""q0: programs that nobody here wrote talk by light, and copper carries none of what they say."""

import json
import re
import shutil
import subprocess
from collections.abc import Iterator
from functools import partial
from ipaddress import IPv6Address
from pathlib import Path

import pytest
from conftest import nothing_left, wait_until
from fabric_scene import light_paths, running
from scapy.layers.inet import IP, TCP
from scapy.packet import Packet
from scapy.utils import rdpcap

from applications.ip_over_light.interfaces import IpOverLight, start_ip_over_light
from topologies.networks.network import Network
from topologies.sdc import SdcTopo
from wire.metadata.header import METADATA_PORT

MARK = b"by light"  # in the packets of a test, and nowhere else
BOB6 = "fd71:6d6e::2"
BOB6_BYTES = IPv6Address(BOB6).packed
DARK_S = 15.0
SSH_PORT = 2222
# A server of ssh that Debian does not start by itself, and its files in the place of root's home.
SSH_SERVER = 'mount --bind "$0" "$1"; exec dropbear -F -E -s -r "$2" -P "$3" -p "$4"'


def if_there(*programs: str) -> pytest.MarkDecorator:
    """Skip a test where programs that are not needed otherwise are not installed."""
    missing = [each for each in programs if shutil.which(each) is None]
    return pytest.mark.skipif(bool(missing), reason=f"not installed: {', '.join(missing)}")


@pytest.fixture(scope="module")
def _scene(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Network]:
    folder = tmp_path_factory.mktemp("run")
    with nothing_left(), running(partial(SdcTopo, both_ways=True), folder) as network:
        network.capture("s1")
        addresses = start_ip_over_light(network, IpOverLight(idle_s=0.5))
        assert addresses == {"alice": "10.1.0.1", "bob": "10.1.0.2", "charlie": "10.1.0.3"}
        yield network


@pytest.fixture
def network(_scene: Network) -> Network:
    """Give the network of the module, all its light given back."""
    wait_until(lambda: not light_paths("q1"), "all light given back", DARK_S)
    _scene.check()
    return _scene


def run(network: Network, host: str, command: str) -> str:
    """Run a command on a host; return what it says."""
    return str(network.host(host).cmd(command)).replace("\r", "")


def pinged(network: Network, host: str, words: str) -> str:
    """Return what ping says to its end."""
    return run(network, host, f"ping -W 30 {words}")


def pings(count: int, words: str) -> str:
    """Return a command of as many pings, each of which waits for its own answer.

    One ping of several waits for the others only twice as long as the first answer took.
    """
    times = " ".join(map(str, range(count)))
    return f"(for each in {times}; do ping -W 30 -c 1 {words} & sleep 0.2; done; wait)"


def answered(text: str) -> int:
    """Return how many of such pings were answered."""
    return text.count(" 1 received")


def copper(network: Network, host: str) -> list[Packet]:
    """Return what a host's copper has carried."""
    ends = [(str(link.intf1), str(link.intf2)) for link in network.net.links]
    (port,) = (far for near, far in ends if near.startswith(f"{host}-") and far.startswith("s1-"))
    return list(rdpcap(str(network.runtime.logs / f"{port}.pcap")))


def test_hosts_ping_each_other_by_light_alone(network: Network) -> None:
    words = ["sh", "-c", pings(20, f"-p {MARK.hex()} -s 64 10.1.0.2")]
    with network.host("alice").popen(words, text=True) as ping:
        # The light of both directions: three ways there, and one more back.
        wait_until(lambda: len(light_paths("q1")) == 4, "light there and back")
        assert answered(ping.communicate()[0]) == 20
    run(network, "alice", "ping -c 1 -p 636f70706572 -s 64 10.0.0.2")

    def seen() -> bytes:
        return b"".join(bytes(packet) for packet in copper(network, "bob"))

    wait_until(lambda: b"coppercopper" in seen(), "the capture of what did go over copper")
    assert MARK not in seen()
    require_light_alone(network)


def require_light_alone(network: Network) -> None:
    """Fail if copper has carried a packet of q0, or TCP between alice and bob but metadata."""
    packets = [packet[IP] for packet in copper(network, "bob") if IP in packet]
    assert not any(str(end).startswith("10.1.") for p in packets for end in (p.src, p.dst))
    between = [p for p in packets if {p.src, p.dst} == {"10.0.0.1", "10.0.0.2"} and TCP in p]
    assert between
    assert all(METADATA_PORT in (p[TCP].sport, p[TCP].dport) for p in between)


def test_a_file_comes_by_http_and_light_is_given_back(network: Network, tmp_path: Path) -> None:
    content = bytes(range(256)) * 400
    (tmp_path / "file").write_bytes(content)
    serve = ["-m", "http.server", "8080", "--bind", "10.1.0.2", "--directory", str(tmp_path)]
    server = network.run_on("bob", "web", ["python3", "-u", *serve])
    try:
        server.wait_for("Serving", 10.0)
        got = tmp_path / "got"
        output = run(
            network, "alice", f"curl -sS -m 60 -o {got} http://10.1.0.2:8080/file; echo $?"
        )
    finally:
        server.stop()
    assert output.split()[-1] == "0", output
    assert got.read_bytes() == content
    wait_until(lambda: not light_paths("q1"), "light given back", DARK_S)
    assert not any(content[:64] in bytes(packet) for packet in copper(network, "alice"))
    # By light that alice has asked for, or by bob's own: whose came first.
    given_back = re.compile(r"given back \(sdc(?:_return)?\).*; (\d+) bytes")
    log = (network.runtime.logs / "q0-bob.log").read_text()
    assert sum(map(int, given_back.findall(log))) > len(content)


@if_there("ssh", "ssh-keygen", "scp", "dropbear", "dropbearkey")
def test_a_shell_and_a_copied_file_come_by_light(network: Network, tmp_path: Path) -> None:
    key, server_key, home = (tmp_path / name for name in ("key", "server-key", "home"))
    subprocess.run(["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-f", key], check=True)
    made = ["dropbearkey", "-t", "ed25519", "-f", str(server_key)]
    subprocess.run(made, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    (home / ".ssh").mkdir(mode=0o700, parents=True)
    home.chmod(0o700)
    shutil.copy(key.with_suffix(".pub"), home / ".ssh" / "authorized_keys")
    (tmp_path / "file").write_bytes(content := bytes(range(256)) * 800)
    words = [home, Path("~root").expanduser(), server_key, tmp_path / "pid", f"10.1.0.2:{SSH_PORT}"]
    command = ["unshare", "--mount", "sh", "-ec", SSH_SERVER, *map(str, words)]
    server = network.run_on("bob", "dropbear", command)
    checks = "-o StrictHostKeyChecking=no -o UserKnownHostsFile=/dev/null -o LogLevel=ERROR"
    options = f"-F none -i {key} -o BatchMode=yes -o ConnectTimeout=30 {checks}"
    try:
        server.wait_for("Not backgrounding", 10.0)
        output = run(
            network, "alice", f"ssh -p {SSH_PORT} {options} root@10.1.0.2 ip -o -4 addr show q0"
        )
        assert " 10.1.0.2/" in output
        copied = f"{tmp_path}/file root@10.1.0.2:{tmp_path}/copied"
        output = run(network, "alice", f"scp -O -P {SSH_PORT} {options} {copied}; echo $?")
    finally:
        server.stop()
    assert output.split()[-1] == "0", output
    assert (tmp_path / "copied").read_bytes() == content
    require_light_alone(network)


@if_there("iperf3")
def test_iperf3_measures_light(network: Network) -> None:
    server = network.run_on(
        "bob", "iperf3", ["iperf3", "-s", "-1", "-B", "10.1.0.2", "--forceflush"]
    )
    try:
        server.wait_for("listening on", 10.0)
        output = run(network, "alice", "iperf3 -c 10.1.0.2 -n 3M --json")
    finally:
        server.stop()
    ended = json.loads(output)["end"]
    assert ended["sum_sent"]["bytes"] >= 3 << 20
    assert ended["sum_received"]["bytes"] > 1 << 20  # what is under way in the end is not counted
    require_light_alone(network)


def test_who_makes_pairs_has_those_of_another(network: Network) -> None:
    assert answered(run(network, "alice", pings(2, "10.1.0.3"))) == 2


def test_two_that_begin_at_once_share_the_light_of_one(network: Network) -> None:
    network.host("bob").sendCmd(pings(3, "10.1.0.1"))
    assert answered(run(network, "alice", pings(3, "10.1.0.2"))) == 3
    assert answered(network.host("bob").waitOutput()) == 3


def test_an_address_that_nobody_has_is_answered(network: Network) -> None:
    text = pinged(network, "alice", "-c 1 10.1.0.77")
    assert "From 10.1.255.254 icmp_seq=1 Destination Host Unknown" in text


def test_a_cut_fibre_is_answered_and_mended_light_is_used_again(network: Network) -> None:
    network.net.configLinkStatus("bob", "q1", "down")
    try:
        wait_until(
            lambda: "Unreachable" in pinged(network, "alice", "-c 1 10.1.0.2"), "an error", DARK_S
        )
    finally:
        network.net.configLinkStatus("bob", "q1", "up")
    wait_until(
        lambda: "1 received" in pinged(network, "alice", "-c 1 10.1.0.2"), "light after mending"
    )


def test_hosts_ping_each_other_by_ipv6_and_nothing_of_it_is_on_copper(network: Network) -> None:
    pattern = f"-p {MARK.hex()} -s 64"
    assert answered(run(network, "alice", pings(2, f"-6 {pattern} {BOB6}"))) == 2
    assert "1 received" in pinged(network, "bob", f"-6 -c 1 {pattern} fd71:6d6e::1")
    for host in ("alice", "bob"):
        frames = [bytes(packet) for packet in copper(network, host)]
        assert frames
        assert not any(MARK in frame or BOB6_BYTES in frame for frame in frames)


def test_what_cannot_be_had_by_ipv6_is_an_icmpv6_error(network: Network) -> None:
    text = pinged(network, "alice", "-6 -c 1 fd71:6d6e::77")
    assert "From fd71:6d6e::ffff:ffff:ffff:ffff icmp_seq=1" in text
    assert "Address unreachable" in text
