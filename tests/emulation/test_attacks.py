"""Attacks with their defence off, and with it on."""

from pathlib import Path

import pytest
from conftest import verb, wait_until
from fabric_scene import running

from evidence.attacks.laboratory import ATTACKS, Attack
from qmn.scripting import start
from topologies.sdc import SdcTopo
from topologies.system.processes.programs import python

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
asked = Setup(1, Service.TELEPORT, 1, own, 100, 1, 1_000_000, port=9).encode()
frame = bytes(Ether(src=own_mac(channel), dst=to_mac) / IP(src=own, dst=to) / segment / asked)
while True:
    for _frame in range(burst):
        channel.send(frame)
    time.sleep(pause_s)
"""
BURST, PAUSE_S = 50, 0.0005  # some 50,000 a second


def test_a_flood_leaves_others_their_light(tmp_path: Path) -> None:
    """Queues for each port are served in turn (Open vSwitch's ofproto/pinsched.c).

    Without them the first of these sessions hears that nobody answers. The flood has the lowest
    priority: what comes for the controller takes it a fifth of a processor, which it must get.
    """
    with start("tree", tmp_path / "run", hosts=4, switches=1) as network:
        flooder, victim = network.host("h4"), network.host("bob")
        interface = str(flooder.defaultIntf())
        flooder.cmd(f"ping -c 1 {victim.IP()}")
        words = (interface, victim.MAC(), flooder.IP(), victim.IP(), BURST, PAUSE_S)
        command = ["nice", "-n", "19", python(), "-c", FLOOD.format(words=words)]
        with flooder.popen(command) as flood:
            try:
                sent = f"cat /sys/class/net/{interface}/statistics/tx_packets"
                wait_until(lambda: int(flooder.cmd(sent)) > 100_000, "a flood")
                for number in range(5):
                    assert network.send("alice", "bob", bytes([number])).data == bytes([number])
            finally:
                flood.kill()


def test_the_verb_prints_the_count() -> None:
    assert {*ATTEMPTS, *TLS} == {each for each in ATTACKS if isinstance(ATTACKS[each], Attack)}
    said = verb("lab", "attack", "set-up-flooding", "--attempts", "5", "--defence", "on").stdout
    assert "set-up-flooding" in said
    assert "handshakes on" in said
    assert "0 of 5 set-ups" in said
