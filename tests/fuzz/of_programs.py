"""Decoders that a program has for itself: the agent's, the controller's, a tunnel's, Sabot's."""

import io
from collections.abc import Callable
from math import isfinite

import mutations
import test_agent_mutations
import test_recovery
import test_snapshots
from metadata_scene import PER_PAIR
from target import Target

from applications.circuits.circuit import Circuit, CircuitError, Source
from applications.circuits.qasm import read_qasm
from applications.circuits.reading import read_chp
from applications.instruments import scpi_link
from applications.instruments.scpi_link import GarbledReply
from applications.vpn import tls
from controller_apps.sessions import snapshot
from qswitch_agent.openflow import matches
from qswitch_agent.openflow.flows import FlowMod
from qswitch_agent.openflow.refusals import Refusal
from wire.malformed import MalformedPacket

REFUSED = (MalformedPacket, Refusal)


def _read_by(readers: list[Callable[[bytes], object]], kind: int) -> Callable[[bytes], int]:
    """Return what has a message read by all that read its kind; each looks at what it means."""

    def decode(data: bytes) -> int:
        if data[1] != kind:
            raise MalformedPacket("of another kind")
        refusals: list[Exception] = []
        for read in readers:
            try:
                read(data)
            except REFUSED as refusal:
                refusals.append(refusal)
        if len(refusals) == len(readers):
            raise refusals[0]
        return len(refusals)

    return decode


def _openflow(
    side: str, text: list[bytes], readers: dict[int, list[Callable[[bytes], object]]]
) -> dict[str, Target]:
    return {
        f"OpenFlow {kind} of {side}": Target(
            [message for message in text if message[1] == kind],
            _read_by(reading, kind),
            spoil=mutations.spoiled,
            refusals=REFUSED,
        )
        for kind, reading in readers.items()
    }


def _match(data: bytes) -> matches.Fields:
    fields = matches.parse(data)
    assert matches.covers(fields, fields)
    return fields


def _text(data: bytes) -> str:
    return data.decode("latin-1")  # as it comes from the instrument, whatever it says


def _powers(data: bytes) -> list[float]:
    powers = scpi_link.read_powers(_text(data), 3)
    assert len(powers) == 3
    assert all(map(isfinite, powers))
    return powers


def _framed(packet: bytes | None) -> bytes:
    return b"" if packet is None else tls.LENGTH.pack(len(packet)) + packet


def _circuit(read: Callable[[Source], Circuit]) -> Callable[[bytes], Circuit]:
    def decode(data: bytes) -> Circuit:
        circuit = read(Source("program", data.decode(errors="replace")))
        assert circuit == read(Source("program", data.decode(errors="replace")))
        return circuit

    return decode


MESSAGES = [message for scene in mutations.requests() for message in scene]
REGISTERS = 'OPENQASM 2.0;\ninclude "qelib1.inc";\nqreg q[2]; qreg r[2];\ncreg c[2];\n'
QASM = [
    REGISTERS + "h q; cx q, r; measure r -> c;",
    REGISTERS + "gate twice(a) x, y { rz(a*pi/2) x; cx x, y; } twice(.5) q[0], r[1];",
    REGISTERS + "barrier q; if (c==2) reset q[1];",
]
CHP = ["c 0 1 is no\ninstruction #\nh 0\nc 0 3\n\np 3\nm 3\nm 0\n"]

TARGETS: dict[str, Target] = {
    **_openflow("a controller", MESSAGES, test_agent_mutations.OF_CONTROLLER),
    **_openflow("a bridge", mutations.replies(), test_agent_mutations.OF_BRIDGE),
    "OpenFlow match": Target(
        [FlowMod.decode(message).match for message in MESSAGES if message[1] == 14], _match
    ),
    "session that is kept": Target(
        [test_recovery.kept(), test_recovery.kept(PER_PAIR), test_snapshots.golden()],
        lambda data: snapshot.decode_session(data, test_snapshots.NOW),
        snapshot.encode_session,
    ),
    "hosts that are kept": Target(
        [snapshot.encode_hosts(test_snapshots.ABLE)],
        snapshot.decode_hosts,
        snapshot.encode_hosts,
        canonical=False,  # one place may come twice
    ),
    "packet in a tunnel": Target(
        [_framed(b"packet"), tls.ASKING],
        lambda data: tls.read_frame(io.BytesIO(data)),
        _framed,
        canonical=False,  # what comes behind
        refusals=(),
    ),
    "instrument, connections": Target(
        [b"(@1,2),(@17,18)", b"(@),(@)"],
        lambda data: scpi_link.read_connections(_text(data)),
        lambda connections: scpi_link.pairs(connections).encode(),
        canonical=False,  # spaces
        refusals=(GarbledReply,),
    ),
    "instrument, error": Target(
        [b'-222,"Data out of range"', b'0,"No error"'],
        lambda data: scpi_link.read_error(_text(data)),
        lambda both: f'{both[0]},"{both[1]}"'.encode(),
        canonical=False,
        refusals=(GarbledReply,),
    ),
    "instrument, powers": Target([b"(-10.53,+0.0,-6.0e1)"], _powers, refusals=(GarbledReply,)),
    "instrument, port states": Target(
        [b"(E,D,F)"],
        lambda data: scpi_link.read_states(_text(data), 3),
        lambda states: f"({','.join(states)})".encode(),
        canonical=False,
        refusals=(GarbledReply,),
    ),
    "OpenQASM": Target(
        [text.encode() for text in QASM], _circuit(read_qasm), refusals=(CircuitError,)
    ),
    "CHP": Target([text.encode() for text in CHP], _circuit(read_chp), refusals=(CircuitError,)),
}
