"""Attacks with their defence off, and with it on."""

import subprocess
from pathlib import Path

import pytest
from conftest import verb, wait_until
from fabric_scene import facts, light_paths, running, session
from limits import SOON_S
from scapy.layers.inet import IP, TCP
from scapy.layers.l2 import Ether
from scapy.packet import Packet

from evidence.attacks.laboratory import ATTACKS, Attack
from qmn.scripting import start
from topologies.networks.network import Network
from topologies.sdc import SdcTopo
from topologies.system.processes.programs import python
from wire.metadata.header import METADATA_PORT, QUANTUM_SWITCHES, session_number
from wire.metadata.setup import Setup
from wire.metadata.vocabulary import Handshake, Service

ATTEMPTS = {
    "arp-spoofing": 10,
    "flow-table-flooding": 60,
    "set-up-flooding": 40,
    "blind-rst": 1,
    "lldp-spoofing": 20,
    "replay": 10,
}
TLS = {"impostor-switch": 3, "impostor-controller": 5}


def conducted(name: str) -> Attack:
    attack = ATTACKS[name]
    assert isinstance(attack, Attack)
    return attack


@pytest.mark.waits
@pytest.mark.parametrize("defended", [False, True])
def test_attacks_succeed_without_their_defence_alone(tmp_path: Path, defended: bool) -> None:
    """Undefended each attempt succeeds, as ARP, learning switches, TCP and LLDP have it.

    (RFC 826, 793, IEEE 802.1AB.) A frame may be lost on its way to the controller, or bob may hear
    alice herself once, or announce his fibres again meanwhile.
    """
    policy = tmp_path / "policy.toml"
    words = str(defended).lower()
    switches = dict.fromkeys(("addresses", "handshakes", "sequences", "announcements"), words)
    policy.write_text("[filter]\n" + "".join(f"{name} = {on}\n" for name, on in switches.items()))
    with running(SdcTopo, tmp_path, policy=str(policy)) as network:
        for name, attempts in ATTEMPTS.items():
            reached = conducted(name).conduct(network, attempts)
            assert reached == 0 if defended else 0.8 * attempts <= reached <= attempts, (
                name,
                reached,
            )


@pytest.mark.waits
@pytest.mark.parametrize("tls", [False, True])
def test_impostors_are_obeyed_without_tls_alone(tmp_path: Path, tls: bool) -> None:
    """Nothing in OpenFlow itself says who speaks (version 1.4.0, 6.3.3)."""
    with running(SdcTopo, tmp_path, tls=tls) as network:
        for name, attempts in TLS.items():
            assert conducted(name).conduct(network, attempts) == (0 if tls else attempts), name


FLOOD = """
import time

from scapy.layers.inet import IP, TCP
from scapy.layers.l2 import Ether
from evidence.attacks.frames import opened, own_mac
from wire.metadata.header import METADATA_PORT
from wire.metadata.setup import Setup
from wire.metadata.vocabulary import Service

interface, to_mac, own, to, burst, pause_s = {words!r}
channel = opened(interface)
segment = TCP(sport=20_000, dport=METADATA_PORT, flags="PA", seq=1, ack=1, window=502)
asked = Setup(1, Service["TELEPORT"], 1, own, 100, 1, 1_000_000, port=9).encode()
frame = bytes(Ether(src=own_mac(channel), dst=to_mac) / IP(src=own, dst=to) / segment / asked)
while True:
    for _frame in range(burst):
        channel.send(frame)
    time.sleep(pause_s)
"""
BURST, PAUSE_S = 50, 0.0005  # some 50,000 a second


def test_a_flood_leaves_others_their_light(tmp_path: Path) -> None:
    """Queues for each port are served in turn (Open vSwitch's ofproto/pinsched.c).

    Without them the first of these sessions hears that nobody answers. The flood has a low
    priority: what comes for the controller takes it a fifth of a processor, which it must get.
    """
    # Stepped time would stand as long as the flood runs; deadlines are ten times as long, as other
    # tests want processors, too.
    with start("tree", tmp_path / "run", hosts=4, switches=1, time="paced=10") as network:
        flooder, victim = network.host("h4"), network.host("bob")
        interface = str(flooder.defaultIntf())
        flooder.cmd(f"ping -c 1 {victim.IP()}")
        words = (interface, victim.MAC(), flooder.IP(), victim.IP(), BURST, PAUSE_S)
        command = ["nice", "-n", "10", python(), "-c", FLOOD.format(words=words)]
        with flooder.popen(command) as flood:
            try:
                sent = f"cat /sys/class/net/{interface}/statistics/tx_packets"
                wait_until(lambda: int(flooder.cmd(sent)) > 20_000, "a flood")
                for number in range(5):
                    assert network.send("alice", "bob", bytes([number])).data == bytes([number])
            finally:
                flood.kill()


def packet_out(switch: str, in_port: int, frame: Packet, actions: str = "controller") -> None:
    words = ["ovs-ofctl", "-O", "OpenFlow14", "packet-out", switch]
    subprocess.run([*words, f"in_port={in_port} packet={bytes(frame).hex()} actions={actions}"],
                   check=True, timeout=SOON_S)  # fmt: skip


def forge_setup(network: Network) -> Packet:
    """Have c0 get a connection of alice to bob and its set-up, by PACKET_OUTs at s1 alone."""
    alice, bob = network.net["alice"], network.net["bob"]
    tcp = TCP(sport=20_000, dport=METADATA_PORT, flags="PA", seq=1, ack=1, window=502)
    answer = TCP(sport=METADATA_PORT, dport=20_000, flags="SA", seq=0, ack=1)
    back = Ether(src=bob.MAC(), dst=alice.MAC()) / IP(src=bob.IP(), dst=alice.IP())
    packet_out("s1", 2, back / answer)
    number, source = session_number(alice.IP(), 77), network.net["charlie"].IP()
    setup = Setup(number, Service.SDC, Handshake.FRAMED, source, 64, 64, 1_000_000)
    ends = Ether(src=alice.MAC(), dst=bob.MAC()) / IP(src=alice.IP(), dst=bob.IP())
    forged = ends / tcp / setup.encode()
    packet_out("s1", 1, forged)
    return forged


def test_a_forged_set_up_at_c0_opens_light_where_q1_need_not_have_seen_it(tmp_path: Path) -> None:
    with running(SdcTopo, tmp_path) as network:
        forge_setup(network)
        wait_until(lambda: facts(network, "granted"), "light for a session that nobody asked for")
        (granted,) = facts(network, "granted")
        assert granted["copies_ms"] == {"q1": None}


def test_q1_opens_no_light_for_a_set_up_that_has_not_come_to_itself(tmp_path: Path) -> None:
    """Nor after PACKET_OUTs at q1, or for who orders the entries of q1 himself."""
    with running(SdcTopo, tmp_path, metadata_at_switch="required") as network:
        forged = forge_setup(network)
        forged[Ether].dst = QUANTUM_SWITCHES
        for actions in ("table", "controller"):
            packet_out("q1", 1, forged, actions)
        number = session_number(network.net["alice"].IP(), 77)
        entry = f"cookie={number:#x},priority=100,in_port=2,actions=output:4"
        words = ["ovs-ofctl", "-O", "OpenFlow14", "add-flow", "q1", entry]
        done = subprocess.run(words, capture_output=True, text=True, timeout=SOON_S)
        assert "OFPFMFC_EPERM" in done.stderr
        wait_until(lambda: facts(network, "refused"), "a refusal")
        (refused,) = facts(network, "refused")
        assert refused["detail"] == "SETUP_UNSEEN: q1"
        assert light_paths("q1") == {}
        with session(network, "alice", "bob") as honest:
            assert honest.carry(b"seen") == b"seen"


def test_the_verb_prints_the_count() -> None:
    assert {*ATTEMPTS, *TLS} == {each for each in ATTACKS if isinstance(ATTACKS[each], Attack)}
    text = verb("lab", "attack", "set-up-flooding", "--attempts", "5", "--defence", "on").stdout
    assert "set-up-flooding" in text
    assert "handshakes on" in text
    assert "0 of 5 set-ups" in text
