"""Three hosts on one quantum switch (datapath id 2) and the frames they send over s1."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from scapy.layers.inet import IP, TCP
from scapy.layers.l2 import Ether

from controller_apps.light.optics import SwitchOptics, SwitchPort
from controller_apps.light.paths import HostPort, Network
from controller_apps.sessions.arbiter import Arbiter
from wire.metadata.header import METADATA_PORT
from wire.metadata.setup import Setup
from wire.metadata.vocabulary import Handshake, Service
from wire.optical import ANY_PORT, PathOptics

S1, Q1 = 1, 2
ALICE, BOB, CHARLIE = "10.0.0.1", "10.0.0.2", "10.0.0.3"
HOLD_S, IDLE_S = 5.0, 30.0
FIBERS = {
    1: HostPort("alice", ALICE, "alice-q0"),
    2: HostPort("bob", BOB, "bob-q0"),
    3: HostPort("bob", BOB, "bob-q1"),
    4: HostPort("charlie", CHARLIE, "charlie-q0"),
    5: HostPort("charlie", CHARLIE, "charlie-q1"),
}
FRAMED = Setup(7, Service.SDC, Handshake.FRAMED, CHARLIE, 1000, 100, 1_000_000)
PER_PAIR = replace(FRAMED, handshake=Handshake.PER_PAIR)
ONE_PAIR = replace(FRAMED, handshake=Handshake.ONE_PAIR)
PAIR_SOURCE = replace(FRAMED, service=Service.PAIR_SOURCE)
STRANGER = "02:00:00:00:00:99"
MACS = {ALICE: "02:00:00:00:00:01", BOB: "02:00:00:00:00:02", CHARLIE: "02:00:00:00:00:03"}


def network() -> Network:
    """Return the network with every fibre discovered."""
    discovered = Network({Q1})
    for port, host_port in FIBERS.items():
        discovered.attach(SwitchPort(Q1, port), host_port)
    return discovered


def rotating(rotation: int, loss_mdb: int = 0) -> SwitchOptics:
    """Return the optics of a switch whose paths are all alike."""
    return SwitchOptics(PathOptics(ANY_PORT, ANY_PORT, loss_mdb, rotation))


def arbiter(
    rotation: int = 0, queues: bool = False, keys: Mapping[str, str] | None = None
) -> Arbiter:
    """Return an arbiter for it that has seen nothing yet; keys are those of hosts, by address."""
    discovered = network()
    discovered.optics.switches[Q1] = rotating(rotation)
    return Arbiter(discovered, HOLD_S, IDLE_S, queues=queues, keys=keys or {})


def is_live(state: Arbiter, number: int) -> bool:
    """Return whether a session has light."""
    session = state.sessions.by_number.get(number)
    return session is not None and bool(session.paths)


def frame(
    payload: bytes = b"",
    sport: int = 40000,
    seq: int = 100,
    flags: str = "PA",
    source: str = ALICE,
    destination: str = BOB,
    ack: int = 1,
    **tcp: Any,
) -> bytes:
    """Return a frame to the metadata port with correct lengths and checksums."""
    segment = TCP(sport=sport, dport=METADATA_PORT, seq=seq, ack=ack, flags=flags, **tcp)
    ethernet = Ether(src=MACS.get(source, STRANGER), dst=MACS.get(destination, STRANGER))
    return bytes(ethernet / IP(src=source, dst=destination) / segment / payload)


def payload_of(data: bytes) -> bytes:
    """Return the TCP payload as scapy reads it, after checking lengths and checksums."""
    packet = Ether(data)
    again = Ether(data)
    del again[IP].len, again[IP].chksum, again[TCP].chksum
    assert bytes(again) == data
    return bytes(packet[TCP].payload)


def from_bob(flags: str, seq: int, ack: int, dport: int = 40000) -> bytes:
    """Return a frame without data from bob's metadata port to alice."""
    segment = TCP(sport=METADATA_PORT, dport=dport, seq=seq, ack=ack, flags=flags)
    ethernet = Ether(src=MACS[BOB], dst=MACS[ALICE])
    return bytes(ethernet / IP(src=BOB, dst=ALICE) / segment)
