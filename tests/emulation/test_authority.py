"""Hosts that act beyond their rights in a whole network, and the result."""

import re
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from conftest import policy, wait_until
from fabric_scene import captured, facts, running, session
from limits import SOON_S
from scapy.layers.inet import TCP
from scapy.packet import Packet
from scapy.utils import rdpcap
from test_service_faults import ALICE, BOB, CHARLIE, listening, require_nothing_left

from hosts.stack_socket import QuantumSocketError
from qmn.scripting import start
from topologies.networks.network import Network
from topologies.sdc import SdcTopo
from topologies.system.runs.runtime import LIVE_PAGES
from views.live.pages import Pages
from wire.features import EVERYTHING, NodeFeatures
from wire.lldp import announcement
from wire.metadata.decoding import decode, message_length
from wire.metadata.header import METADATA_PORT, NUMBERS_APART, Message, session_number
from wire.metadata.setup import Answer, Setup
from wire.metadata.vocabulary import Reason, Service, Verdict

SETUP = Setup(session_number(ALICE, 9), Service["TELEPORT"], 1, CHARLIE, 100, 1, 1_000_000, port=9)
# More than a segment takes: PSH is set only in the last one, and the set-up is in the first.
BEHIND = bytes(6000)
SPEAK = """
import socket, sys
with socket.create_connection((sys.argv[1], int(sys.argv[2])), 5) as connection:
    connection.settimeout(3)
    connection.sendall(open(sys.argv[3], "rb").read())
    try:
        print("heard=" + connection.recv(65536).hex())
    except TimeoutError:
        print("heard=")
"""


def spoken(network: Network, host: str, data: bytes, to: str = BOB) -> Message | None:
    """Let a host say something to a stack in one write; return what it hears, None for silence."""
    script, text = network.runtime.logs.parent / "speak.py", network.runtime.logs.parent / "speech"
    script.write_text(SPEAK)
    text.write_bytes(data)
    output = network.host(host).cmd(f"{sys.executable} {script} {to} {METADATA_PORT} {text}")
    (heard,) = re.findall(r"heard=([0-9a-f]*)", output)
    answer = bytes.fromhex(heard)
    return decode(answer[: message_length(answer)]) if answer else None


def first_with_payload(capture: Path) -> Packet:
    """Return the first segment to the metadata port that has data."""
    packets = (packet for packet in rdpcap(str(capture)) if TCP in packet)
    segments: Iterator[Packet] = (packet[TCP] for packet in packets)
    return next(each for each in segments if each.dport == METADATA_PORT and bytes(each.payload))


def test_a_segment_without_psh_is_arbitrated_like_any_other(shared_network: Network) -> None:
    network, before = shared_network, len(facts(shared_network, "granted"))
    granted = replace(SETUP, verdict=Verdict.GRANTED)
    with captured(network, "s1-eth1") as capture, listening(network, "teleport"):
        assert spoken(network, "alice", granted.encode() + BEHIND) is None
        own = replace(SETUP, session=session_number(ALICE, 1))
        asked = spoken(network, "alice", own.encode() + BEHIND)
        assert isinstance(asked, Answer)
        assert asked.reason == Reason.OK  # what follows is not a message, and ends it
        require_nothing_left(network)
        (fact,) = facts(network, "granted")[before:]
        assert fact["session"] == "0a00000100000080"
    assert first_with_payload(capture).flags == "A"


SEND = """
import sys
from scapy.all import ARP, Ether, IP, Raw, UDP, sendp
own, foreign = sys.argv[2:4]
for source, layer in [
    (foreign, IP(src="10.0.0.1", dst="10.0.0.2") / UDP(sport=1, dport=2) / b"foreign MAC"),
    (own, IP(src="10.0.0.1", dst="10.0.0.2") / UDP(sport=1, dport=2) / b"foreign IP"),
    (own, ARP(op=2, hwsrc=own, psrc="10.0.0.1", pdst="10.0.0.2") / b"foreign ARP"),
    (own, ARP(op=2, hwsrc=foreign, psrc="10.0.0.3", pdst="10.0.0.2") / b"foreign ARP MAC"),
    (foreign, Raw(b"foreign frame")),
    (own, IP(src="10.0.0.3", dst="10.0.0.2") / UDP(sport=1, dport=2) / b"own"),
]:
    sendp(Ether(src=source, dst="ff:ff:ff:ff:ff:ff", type=0x9999) / layer
          if isinstance(layer, Raw) else Ether(src=source, dst="ff:ff:ff:ff:ff:ff") / layer,
          iface=sys.argv[1], verbose=False)
"""
FOREIGN = (b"foreign MAC", b"foreign IP", b"foreign ARP", b"foreign ARP MAC", b"foreign frame")


def pose_as_alice(network: Network) -> bytes:
    """Let charlie send frames as alice, then one of his own; return what bob's link has carried."""
    script = network.runtime.logs.parent / "send.py"
    script.write_text(SEND)
    charlie, alice = network.host("charlie"), network.host("alice")
    words = f"{charlie.defaultIntf()} {charlie.MAC()} {alice.MAC()}"
    with captured(network, "s1-eth2") as capture:
        output = charlie.cmd(f"{sys.executable} {script} {words}")
        assert "Traceback" not in output, output
        wait_until(lambda: b"own" in capture.read_bytes(), "own")
        return capture.read_bytes()


def test_a_host_speaks_from_its_own_addresses_alone(shared_network: Network) -> None:
    carried = pose_as_alice(shared_network)
    assert not [words for words in FOREIGN if words in carried]


def test_for_attack_studies_hosts_may_pose_as_others(shared_network: Network) -> None:
    with policy(shared_network, "[filter]\naddresses = false\n"):
        carried = pose_as_alice(shared_network)
    assert [words for words in FOREIGN if words in carried] == list(FOREIGN)
    hosts = [shared_network.host(name) for name in ("alice", "bob", "charlie")]
    for host in hosts:
        host.cmd("ip neigh flush all")  # bob and the switch have believed charlie
    assert shared_network.net.ping(hosts, timeout="2") == 0


HIDE = """
import sys
from itertools import product
from scapy.all import ARP, Dot1AD, Dot1Q, Ether, IP, Raw, TCP, UDP, fragment, sendp
own, bob = sys.argv[2:4]
setup = IP(dst="10.0.0.2") / TCP(sport=4, dport=int(sys.argv[4])) / (b"hidden set-up" + bytes(99))
poison = ARP(op=2, hwsrc=own, psrc="10.0.0.1", pdst="10.0.0.2") / b"hidden ARP"
posing = IP(src="10.0.0.1", dst="10.0.0.2") / UDP(sport=1, dport=2) / b"hidden IP"
tags = [a(vlan=0) / b(vlan=0) for a, b in product((Dot1Q, Dot1AD), repeat=2)]
pieces = fragment(IP(dst="10.0.0.2") / UDP(sport=1, dport=2) / (bytes(2000) + b"own"), 800)
for layer in [
    *(tag / hidden for tag in tags for hidden in (setup, poison, posing)),
    Dot1Q(vlan=0) / Dot1Q(vlan=0) / Dot1Q(vlan=0) / poison,
    *fragment(setup, 64),
    Dot1Q(vlan=7) / IP(dst="10.0.0.2") / UDP(sport=1, dport=2) / b"under one tag",
    *pieces,
]:
    sendp(Ether(src=own, dst=bob) / layer, iface=sys.argv[1], verbose=False)
"""


def test_nothing_passes_that_the_switch_cannot_see_into(shared_network: Network) -> None:
    """Linux takes off any number of VLAN tags of number 0, and puts pieces of TCP together."""
    network = shared_network
    script = network.runtime.logs.parent / "hide.py"
    script.write_text(HIDE)
    charlie, bob = network.host("charlie"), network.host("bob")
    words = f"{charlie.defaultIntf()} {charlie.MAC()} {bob.MAC()} {METADATA_PORT}"
    with captured(network, "s1-eth2") as capture:
        output = charlie.cmd(f"{sys.executable} {script} {words}")
        assert "Traceback" not in output, output
        wait_until(lambda: b"own" in capture.read_bytes(), "what is in pieces, and no TCP")
        carried = capture.read_bytes()
    assert b"under one tag" in carried
    assert b"hidden" not in carried


def take_the_next_number_of_alice(network: Network) -> tuple[Reason, int]:
    """Let charlie open a session at bob under it; return the reply, and the number."""
    before = len(facts(network, "granted"))
    with session(network, "alice", "bob") as opened:
        assert opened.carry(b"first") == b"first"
    require_nothing_left(network)
    number = int(str(facts(network, "granted")[before]["session"]), 16) + NUMBERS_APART
    with listening(network, "teleport"):
        report = spoken(network, "charlie", replace(SETUP, session=number).encode())
    assert isinstance(report, Answer)
    require_nothing_left(network)
    return Reason(report.reason), number


def test_nobody_takes_the_number_of_another_s_session(shared_network: Network) -> None:
    network = shared_network
    reason, number = take_the_next_number_of_alice(network)
    assert reason == Reason.NOT_ALLOWED
    with session(network, "alice", "bob") as opened:
        assert opened.carry(b"second") == b"second"
    assert f"{number:016x}" in {fact["session"] for fact in facts(network, "granted")}


def test_for_attack_studies_hosts_may_take_others_numbers(shared_network: Network) -> None:
    network = shared_network
    with policy(network, "[filter]\nnumbers = false\n"):
        reason, number = take_the_next_number_of_alice(network)
        assert reason == Reason.OK
        with (
            pytest.raises(QuantumSocketError, match=f"session {number:016x} was here before"),
            session(network, "alice", "bob"),
        ):
            pytest.fail("charlie has not taken the number")


ANNOUNCE = """
import socket, sys
channel = socket.socket(socket.AF_PACKET, socket.SOCK_RAW)
channel.bind((sys.argv[1], 0))
channel.send(bytes.fromhex(sys.argv[2]))
"""


def test_a_host_cannot_announce_the_fibre_of_another(shared_network: Network) -> None:
    network = shared_network
    log = network.runtime.logs / "c0.log"
    frame = announcement("bob", "bob-q0", BOB, bytes(6), 30, NodeFeatures(EVERYTHING, 8))
    script = network.runtime.logs.parent / "announce.py"
    script.write_text(ANNOUNCE)
    output = network.host("charlie").cmd(f"{sys.executable} {script} charlie-q0 {frame.hex()}")
    assert output == ""
    wait_until(lambda: "LLDP in the name of bob without its seal" in log.read_text(), "a complaint")
    ports = {fact["at"] for fact in facts(network, "fiber") if fact["host"] == "bob"}
    assert len(ports) == 2  # those of his own two fibres


IMPOSTOR = """
import os, socket, struct, sys
os.setuid(int(sys.argv[3]))
with socket.create_connection(("127.0.0.1", int(sys.argv[1])), 5) as connection:
    connection.settimeout(10)
    stream = connection.makefile("rb")
    connection.sendall(struct.pack("!BBHI", 5, 0, 8, 1))
    while header := stream.read(8):
        _version, kind, length, xid = struct.unpack("!BBHI", header)
        stream.read(length - 8)
        if kind == 5:  # FEATURES_REQUEST
            features = struct.pack("!QIBB2xII", int(sys.argv[2], 16), 0, 254, 0, 0x4F, 0)
            connection.sendall(struct.pack("!BBHI", 5, 6, 8 + len(features), xid) + features)
        elif kind == 18:  # MULTIPART_REQUEST for ports
            connection.sendall(struct.pack("!BBHIHH4x", 5, 19, 16, xid, 13, 0))
print("sent away")
"""


def pose(network: Network, dpid: int, user: int) -> str:
    """Connect to c0 as a switch, as a process of a user beside it; return what becomes of it."""
    (c0,) = network.net.controllers
    command = ["mnexec", "-a", str(c0.pid), sys.executable, "-c", IMPOSTOR]
    words = [str(network.runtime.settings.openflow_port), f"{dpid:x}", str(user)]
    done = subprocess.run(
        [*command, *words], capture_output=True, text=True, check=False, timeout=SOON_S
    )
    return done.stdout + done.stderr


def test_nobody_poses_as_a_switch(shared_network: Network) -> None:
    network = shared_network
    q1, log = network.runtime.datapath_ids["q1"], network.runtime.logs / "c0.log"
    gone = log.read_text().count("is gone")
    for dpid, user, cause in ((q1, 0, "connected already"), (0x77, 65534, "of user 65534")):
        assert pose(network, dpid, user) == "sent away\n"
        assert f"poses as switch {dpid:#x}" in log.read_text()
        assert cause in log.read_text()
    assert log.read_text().count("is gone") == gone
    with session(network, "alice", "bob") as opened:  # q1 was not displaced
        assert opened.carry(b"through q1") == b"through q1"


def test_a_host_does_not_act_by_the_page_of_the_command_that_runs_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With its secret and its socket one has the rights of an operator."""
    pages = Pages(tmp_path / "pages")
    pages.folder.mkdir(mode=0o700)
    monkeypatch.setenv(LIVE_PAGES, str(pages.folder))
    assert pages.secret
    with running(SdcTopo, tmp_path) as network:
        output = network.host("charlie").cmd(f"cat ${LIVE_PAGES}/secret; find ${LIVE_PAGES}")
    assert pages.secret not in output
    assert output.split()[-1] == str(pages.folder)  # it is empty


def test_earlier_runs_are_hidden_where_there_is_nothing_else(tmp_path: Path) -> None:
    """Files that people keep beside their runs, as a script, stay readable on a host."""
    runs, mixed, earlier = tmp_path / "runs", tmp_path / "mixed", "20261122T015233-sdc"
    for folder, seen in ((runs, []), (mixed, [earlier, "now", "script.py"])):
        (folder / earlier).mkdir(parents=True)
        (folder / earlier / "result.json").write_text("a message")
        if seen:
            (folder / "script.py").touch()
        with start("sdc", folder / ("now" if seen else "20261123T015233-sdc")) as network:
            assert network.host("bob").cmd(f"ls {folder}").split() == seen
