"""VPNs that nobody here wrote, keyed by photons: a file passes while their keys change."""

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from conftest import TSHARK, wait_until
from fabric_scene import running
from limits import PROGRAM_S, SOON_S
from loaded import run_qmn, running_qmn
from scapy.layers.inet import TCP, UDP
from scapy.utils import PcapReader
from test_results_fit_schema import require_schema

from applications.keys.config import KeyLink
from applications.keys.key_managers import KeyService, start_key_managers
from applications.vpn.tls import PORT as TLS_PORT
from applications.vpn.tunnel import INSIDE, SOCKETS, charon_socket, start_charon, start_tunnel
from applications.vpn.wireguard import PORT
from topologies.networks.network import Network
from topologies.sdc import SdcTopo
from topologies.system.confinement.confinement import descendants

ROTATE_S, LIFETIME_S = 1.0, 2.0
SLACK_S = 1.0  # of a busy machine
# The first byte of WireGuard's messages (its paper, section 5.4).
INITIATION, RESPONSE = 1, 2
USE_PPK = 16_435  # RFC 8784, section 6
# It brings a daemon that Debian starts at once, so that nobody gets it without asking for it.
IF_THERE = pytest.mark.skipif(
    shutil.which("charon-systemd") is None, reason="charon-systemd is not installed"
)
# Offers a wrong key under the id that bob knows.
WRONG_KEY = """
import sys
from pathlib import Path
from uuid import UUID
from applications.vpn.program import tunnel_of
from applications.vpn.format import VpnConfig
tunnel = tunnel_of(VpnConfig.read(Path(sys.argv[1])))
tunnel.use(UUID(sys.argv[2]), bytes(32))
print("handshake", tunnel.handshake_done())
"""

# An end of strongSwan's tunnel by itself; one that begins changes to a key that the other has not.
STRONGSWAN_END = """
import sys, time
from uuid import UUID
from applications.vpn.strongswan import StrongSwan
from applications.vpn.program import KeyInUse
from wire.network_time import REAL_TIME
socket, own, other, inside, other_inside, lifetime_s = sys.argv[1:]
tunnel = StrongSwan(socket, "0c" * 32, own, other, inside, other_inside, own < other)
tunnel.set_up()
in_use = KeyInUse(tunnel, float(lifetime_s), REAL_TIME)
in_use.change(UUID(int=1), bytes(32))
first = time.time()
print("ready", flush=True)
while own > other or not tunnel.handshake_done():
    time.sleep(0.02)
print("handshake", flush=True)
time.sleep(1)
in_use.change(UUID(int=2), bytes(32))
second = time.time()
while in_use.former_since_s is not None:
    assert not tunnel.handshake_done()
    in_use.look()
    time.sleep(0.02)
print("times", first, second, time.time(), flush=True)
while in_use.since_s is not None:
    in_use.look()
    time.sleep(0.02)
print("closed", tunnel.handshake_done(), flush=True)
time.sleep(60)
"""

# An end of the tunnel by itself, with a key that it is given.
TLS_END = """
import sys, tempfile, time
from uuid import UUID
from applications.vpn.tls import Tls
own, other, inside, other_inside, key = sys.argv[1:]
begins = own < other
file = tempfile.mktemp()
tunnel = Tls("tls0", file, (own, other), (inside, other_inside), 24, begins)
tunnel.set_up()
tunnel.use(UUID(int=1), bytes.fromhex(key))
deadline = time.monotonic() + 3
while begins and not tunnel.handshake_done() and time.monotonic() < deadline:
    time.sleep(0.02)
print("answered:", tunnel.handshake_done(), flush=True)
while True:
    time.sleep(1)
"""


@pytest.fixture(autouse=True)
def _no_socket_is_left() -> Iterator[None]:
    yield
    assert list(SOCKETS.glob("*.sock")) == []


def lines_of(log: Path) -> list[dict[str, Any]]:
    """Return the lines of a program, by the clock of this machine."""
    return [json.loads(line) for line in log.read_text().splitlines() if line.startswith("{")]


def messages_of(capture: Path, layer: type[UDP | TCP], port: int) -> list[tuple[float, int, int]]:
    """Return when alice's link has seen which first byte on a port, and how long it all was."""
    with PcapReader(str(capture)) as packets:
        return [
            (float(packet.time), data[0], len(data))
            for packet in packets
            if layer in packet
            and port in (packet[layer].sport, packet[layer].dport)
            and (data := bytes(packet[layer].payload))
        ]


@pytest.mark.by_day(every=2)
@pytest.mark.waits
@pytest.mark.parametrize(
    ("program", "layer", "port", "scale"),
    [
        ("wireguard", UDP, PORT, 1),
        ("wireguard", UDP, PORT, 2),
        ("tls", TCP, TLS_PORT, 1),
        pytest.param("strongswan", UDP, 4500, 1, marks=IF_THERE),
    ],
)
def test_the_tunnel_closes_while_eve_listens_and_the_file_arrives(
    tmp_path: Path, program: str, layer: type[UDP | TCP], port: int, scale: int
) -> None:
    """Times of what is asked for are of the network; logs and captures have those of the wall."""
    file = tmp_path / "file"
    file.write_bytes(os.urandom(4_000_000))  # still moving when the tunnel closes
    words = ["--with", program, "--file", str(file), "--rotate", str(ROTATE_S)]
    words += [
        "--key-lifetime",
        str(LIFETIME_S),
        "--without",
        "events,report",
        "--runs",
        str(tmp_path / "runs"),
    ]
    # A session and the pause before it, seconds of a busy machine, have to fit into her stay.
    words += ["--eve", "0.6", "--at", "2", "--until", "8", "--time", f"paced={scale}"]
    done = run_qmn("run", "vpn", *words, timeout_s=PROGRAM_S)
    assert done.returncode == 0, done.stdout + done.stderr
    assert ("timers on the wall clock: WireGuard's" in done.stdout) == (scale != 1)
    folder = tmp_path / "runs" / "latest"
    assert (folder / "received").read_bytes() == file.read_bytes()
    require_schema(folder)
    alice, bob = (lines_of(folder / f"vpn-{host}.log") for host in ("alice", "bob"))
    keys = {
        host: [each["key_ID"] for each in text if each["event"] == "key"]
        for host, text in (("alice", alice), ("bob", bob))
    }
    # The last change of keys may be going on when the network ends.
    assert all(one == other for one, other in zip(keys["alice"], keys["bob"], strict=False))
    assert abs(len(keys["alice"]) - len(keys["bob"])) <= 1
    assert len(set(keys["alice"])) == len(keys["alice"]) >= 3
    packets = (folder / "s1-eth1.pcap").read_bytes()
    assert file.read_bytes()[1000:1032] not in packets
    alarm_comes_before_the_end(folder, alice, scale)
    download_takes_its_time(folder, file.stat().st_size, scale)
    messages = messages_of(folder / "s1-eth1.pcap", layer, port)
    nothing_passes_while_it_is_closed(messages, alice, bob)
    handshakes = {each["key_ID"] for each in alice if each["event"] == "handshake"}
    if program == "wireguard":
        kinds = [kind for _at, kind, _length in messages]
        assert kinds.count(INITIATION) >= kinds.count(RESPONSE) >= len(handshakes)
    elif program == "tls":
        hellos = client_hellos(folder / "s1-eth1.pcap", port)
        assert set(hellos) >= handshakes
    else:
        assert notifications(folder / "s1-eth1.pcap", USE_PPK) >= 2 * len(handshakes)


def alarm_comes_before_the_end(folder: Path, alice: list[dict[str, Any]], scale: int) -> None:
    """Fail unless eve is found, no key comes after that, and the last one ends in its time."""
    managed = lines_of(folder / "kme-alice.log")
    alarm = next(each for each in managed if each["event"] == "alarm")
    assert abs(alarm["qber"] - 0.15) < 5 * (0.15 * 0.85 / 1200) ** 0.5  # a quarter of .6
    again = next(
        each["at"] for each in managed if each["event"] == "session" and each["at"] > alarm["at"]
    )
    since, _until = longest_closed(alice)
    closed = next(each for each in alice if (each["event"], each["at"]) == ("tunnel_closed", since))
    used = [each["at"] for each in alice if each["event"] == "key"]
    # One may have been given out already when the alarm came.
    assert not [at for at in used if alarm["at"] + SLACK_S < at < again]
    last = max(at for at in used if at < closed["at"])
    lifetime_s = LIFETIME_S * scale
    assert last + lifetime_s <= closed["at"] < last + lifetime_s + SLACK_S
    assert closed["at"] < alarm["at"] + lifetime_s + SLACK_S
    assert closed["key_age_s"] == pytest.approx(LIFETIME_S, abs=SLACK_S / scale)
    # Keys change in time, unless one could not be had; each may be late.
    reports = [each for each in alice if each["event"] in ("key", "no_key")]
    apart = [b["at"] - a["at"] for a, b in pairwise(reports) if a["event"] == b["event"] == "key"]
    assert sum(apart) > 0.75 * len(apart) * ROTATE_S * scale


def download_takes_its_time(folder: Path, size: int, scale: int) -> None:
    """Fail if more comes than the 4 Mbit a second of the network that `--mbit-s` says by itself."""
    report = lines_of(folder / "download-alice.log")
    first, last = report[0], report[-1]
    passed_s = (last["at"] - first["at"]) / scale
    assert passed_s >= 0.9 * (size - first["bytes"]) * 8 / 4e6


def nothing_passes_while_it_is_closed(
    messages: list[tuple[float, int, int]], alice: list[dict[str, Any]], bob: list[dict[str, Any]]
) -> None:
    """Fail unless packets of the tunnel are in the capture while it is open, and only then."""
    (closed_one, opened_one), (closed_other, opened_other) = map(longest_closed, (alice, bob))
    closed, opened = max(closed_one, closed_other), min(opened_one, opened_other)
    assert opened > closed
    passed = [at for at, _kind, length in messages if length > 1000]
    assert [at for at in passed if at < closed]
    assert [at for at in passed if at > opened]
    assert not [at for at in passed if closed + SLACK_S < at < opened]


def longest_closed(text: list[dict[str, Any]]) -> tuple[float, float]:
    """Return from when to when an end was closed longest: a change of keys may be late as well."""
    reports = [each for each in text if each["event"] in ("tunnel_closed", "tunnel_opened")]
    closed = [(a["at"], b["at"]) for a, b in pairwise(reports) if a["event"] == "tunnel_closed"]
    return max(closed, key=lambda times: times[1] - times[0])


def notifications(capture: Path, kind: int) -> int:
    """Return how many IKE messages of a capture have a notification, by Wireshark."""
    command = [*TSHARK, "-r", str(capture), "-Y", f"isakmp.notify.msgtype == {kind}"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    return len(done.stdout.splitlines())


def client_hellos(capture: Path, port: int) -> list[str]:
    """Return the identities of preshared keys that are offered for TLS 1.3, by Wireshark."""
    offered = f"tls.handshake.type == 1 && tcp.dstport == {port}"
    fields = ["-T", "fields", "-e", "tls.handshake.extensions.psk.identity.identity"]
    # With OpenSSL 3.5's ML-KEM it is two segments; on a busy machine the second may come first.
    order = ["-o", "tcp.reassemble_out_of_order:TRUE"]
    command = [*TSHARK, *order, "-r", str(capture), "-d", f"tcp.port=={port},tls", "-Y", offered]
    done = subprocess.run([*command, *fields], capture_output=True, text=True, check=True)
    return [bytes.fromhex(line.replace(":", "")).decode() for line in done.stdout.split()]


@contextmanager
def tunnelled(
    tmp_path: Path, program: str, rotate_s: float = 500.0, lifetime_s: float = 600.0
) -> Iterator[Network]:
    """Start a tunnel, whose key stays as it is by default."""
    pairs, link = [("alice", "bob")], KeyLink("", True, low=2, high=4, options={"count": 12_000})
    with running(SdcTopo, tmp_path) as network:
        start_key_managers(network, KeyService(pairs, link))
        tunnel = start_tunnel(network, ("alice", "bob"), rotate_s, lifetime_s, program)
        log = tunnel.programs[0].log
        wait_until(lambda: '"handshake"' in log.read_text(), "the first handshake")
        yield network


@pytest.mark.by_day(every=2)
@pytest.mark.parametrize("silent", ["vpn-bob", "kme-alice"])
def test_the_tunnel_closes_in_time_while_its_end_waits_for_an_answer(
    tmp_path: Path, silent: str
) -> None:
    with tunnelled(tmp_path, "wireguard", ROTATE_S, LIFETIME_S) as network:
        log = network.runtime.logs / "vpn-alice.log"
        (pid,) = descendants_named(os.getpid(), silent)
        os.kill(pid, signal.SIGSTOP)
        try:
            wait_until(lambda: "tunnel_closed" in log.read_text(), "alice closes the tunnel")
        finally:
            os.kill(pid, signal.SIGCONT)
    text = lines_of(log)
    closed = next(each for each in text if each["event"] == "tunnel_closed")
    last = max(each["at"] for each in text if each["event"] == "key" and each["at"] < closed["at"])
    assert last + LIFETIME_S <= closed["at"] < last + LIFETIME_S + SLACK_S


def test_without_the_same_key_at_both_ends_nothing_passes(tmp_path: Path) -> None:
    with tunnelled(tmp_path, "wireguard") as network:
        wrong_key_in_wireguard(network)


def wrong_key_in_wireguard(network: Network) -> None:
    """Fail unless the tunnel passes packets with the key that bob has, and with no other."""
    alice = network.host("alice")
    ping = "ping -c1 -W2 192.168.77.2"

    def wg(host: str, script: str) -> str:
        """Run a script beside the programs of the tunnel; hosts have a /run of their own."""
        enter = ["mnexec", "-a", str(network.host(host).pid), "sh", "-c", script]
        return subprocess.run(enter, capture_output=True, text=True, check=True).stdout

    def use(key: str) -> None:
        peer, endpoint = "peer $PEER", "endpoint 10.0.0.2:51820 allowed-ips 192.168.77.2/32"
        given = f"{peer} remove {peer} preshared-key /dev/stdin {endpoint}"
        wg("alice", f"PEER=$(wg show wg-alice peers) && echo {key} | wg set wg-alice {given}")

    assert " 0% packet loss" in alice.cmd(ping)
    _peer, right = wg("alice", "wg show wg-alice preshared-keys").split()
    assert right == wg("bob", "wg show wg-bob preshared-keys").split()[1]
    use("AAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAA=")
    assert "100% packet loss" in alice.cmd(ping)
    use(right)
    assert " 0% packet loss" in alice.cmd(ping)


def listening(network: Network, host: str) -> set[str]:
    """Return the TCP sockets of a host that listen, a line each."""
    return {" ".join(line.split()) for line in network.host(host).cmd("ss -Hltn").splitlines()}


def more_listening(network: Network, host: str, before: set[str]) -> bool:
    return bool(listening(network, host) - before)


@pytest.mark.image
def test_without_the_same_psk_tls_gives_up(tmp_path: Path) -> None:
    script = tmp_path / "end.py"
    script.write_text(TLS_END)
    ping = "ping -c1 -W1 192.168.77.2"
    right, wrong = "0b" * 32, "0c" * 32
    with running(SdcTopo, tmp_path) as network:
        for key, answer, lost in ((wrong, "False", "100%"), (right, "True", " 0%")):
            before, ends = listening(network, "bob"), []
            for host, words in (
                ("bob", ("10.0.0.2", "10.0.0.1", "192.168.77.2", "192.168.77.1", right)),
                ("alice", ("10.0.0.1", "10.0.0.2", "192.168.77.1", "192.168.77.2", key)),
            ):
                command = [sys.executable, str(script), *words]
                ends.append(network.run_on(host, f"{host}-{answer}", command))
                wait_until(partial(more_listening, network, "bob", before), "bob's server")
            ends[1].wait_for("answered", 30.0, network.check)
            # Before and after that OpenSSL says what became of other attempts.
            assert ends[1].output().split("answered: ")[1].split()[0] == answer
            assert f"{lost} packet loss" in network.host("alice").cmd(ping)
            for end in ends:
                end.stop()


@pytest.mark.image
@IF_THERE
def test_without_the_same_ppk_ike_gives_up(tmp_path: Path) -> None:
    ping = "ping -c1 -W2 192.168.77.2"
    with tunnelled(tmp_path, "strongswan") as network:
        alice, runtime = network.host("alice"), network.runtime
        assert " 0% packet loss" in alice.cmd(ping)
        text = lines_of(runtime.logs / "vpn-alice.log")
        key = [each for each in text if each["event"] == "handshake"][-1]
        script = tmp_path / "wrong.py"
        script.write_text(WRONG_KEY)
        config = runtime.folder / "vpn-alice.json"
        command = [sys.executable, str(script), str(config), key["key_ID"]]
        tried = network.run_on("alice", "wrong-key", command)
        tried.wait_for("handshake", 30.0, network.check)
        assert tried.output().strip() == "handshake False"
        log = runtime.logs / "charon-alice.log"
        wait_until(lambda: "N(AUTH_FAILED)" in log.read_text(), "bob refuses the key")
        assert "100% packet loss" in alice.cmd(ping)


@IF_THERE
def test_strongswan_begins_the_next_association_before_it_ends_the_last(tmp_path: Path) -> None:
    with tunnelled(tmp_path, "strongswan", ROTATE_S) as network:
        log = network.runtime.logs / "charon-bob.log"
        wait_until(lambda: log.read_text().count("deleting IKE_SA") >= 3, "three changes of keys")
    words = r"IKE_SA qmn-\d\[(\d+)\] established|deleting IKE_SA qmn-\d\[(\d+)\]"
    newest, ended = 0, []
    for begun, deleted in re.findall(words, log.read_text()):
        if begun:
            newest = int(begun)
        else:
            ended.append((int(deleted), newest))
    assert len(ended) >= 3
    assert all(number < newest for number, newest in ended[:3])  # the last ends with the network


@pytest.mark.nightly
@IF_THERE
def test_strongswan_uses_the_key_before_no_longer_than_its_lifetime(tmp_path: Path) -> None:
    """Where bob has not the next key: packets pass until the lifetime of theirs is over."""
    script = tmp_path / "end.py"
    script.write_text(STRONGSWAN_END)
    lifetime_s, hosts = 8.0, ("alice", "bob")
    with running(SdcTopo, tmp_path) as network:
        sockets = {host: charon_socket(network, host) for host in hosts}
        addresses, ends = network.runtime.addresses, {}
        for host, other, inside in zip(hosts[::-1], hosts, (INSIDE[::-1], INSIDE), strict=True):
            start_charon(network, host)
            words = [sockets[host], addresses[host], addresses[other], *inside, str(lifetime_s)]
            ends[host] = network.run_on(host, f"end-{host}", [sys.executable, str(script), *words])
            ends[host].wait_for("ready", SOON_S, network.check)
        ends["alice"].wait_for("handshake", SOON_S, network.check)
        pings = network.run_on("alice", "pings", ["ping", "-D", "-i", "0.05", INSIDE[1]])
        ends["alice"].wait_for("times", SOON_S, network.check)
        time.sleep(2 * SLACK_S)
        answered = [float(at) for at in re.findall(r"\[([\d.]+)\] 64 bytes from", pings.output())]
        ends["alice"].wait_for("closed", SOON_S, network.check)
    lines = ends["alice"].output().split("times ")[1].split()
    first, second, ended = map(float, lines[:3])
    assert lines[-2:] == ["closed", "False"]
    assert first + lifetime_s <= ended < first + lifetime_s + SLACK_S
    assert [at for at in answered if second + SLACK_S < at < ended]
    assert max(answered) < ended + SLACK_S


@pytest.mark.by_day(every=2)
@pytest.mark.parametrize("struck", ["download-alice", "wireguard-bob"])
def test_a_program_of_the_tunnel_that_is_killed_is_named(tmp_path: Path, struck: str) -> None:
    words = ["run", "vpn", "--mbit-s", "0.5", "--without", "report", "--runs", str(tmp_path)]
    with (tmp_path / "errors").open("w+") as errors, running_qmn(*words, errors=errors) as process:
        log = tmp_path / "latest" / f"{struck}.log"
        wait_until(log.exists, f"{struck} is started")
        wait_until(lambda: descendants_named(process.pid, struck), f"{struck} runs")
        for pid in descendants_named(process.pid, struck):
            os.kill(pid, signal.SIGKILL)
        process.wait(60.0)
        errors.seek(0)
        text = errors.read()
    assert process.returncode == 1
    assert f"{struck} died in mid-run: killed by SIGKILL" in text


def descendants_named(pid: int, name: str) -> list[int]:
    """Return the programs below a process that have such a log."""
    found = []
    for each in descendants(pid):
        with suppress(OSError):
            if f"/{name}.log" in os.readlink(f"/proc/{each}/fd/2"):
                found.append(each)
    return found
