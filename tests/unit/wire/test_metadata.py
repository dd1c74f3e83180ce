"""Quantum metadata: golden bytes both ways, every truncation, an independent decoder."""

from dataclasses import replace
from typing import Any

import pytest
from scapy.fields import (
    IntField,
    IPField,
    LongField,
    ShortField,
    SignedIntField,
    StrFixedLenField,
    XByteField,
    XShortField,
)
from scapy.packet import Packet

from wire.malformed import MalformedPacket
from wire.metadata.blocks import Block, Emission, Emit, Emitted, Finish, Frame, Report
from wire.metadata.decoding import decode, message_length
from wire.metadata.header import Message, is_number_of, session_number
from wire.metadata.setup import SETUP_LENGTH, Answer, Setup
from wire.metadata.values import Envelope, Topic, Values
from wire.metadata.vocabulary import Handshake, Reason, Service, Verdict
from wire.outcomes import Pauli

SETUP = Setup(
    session=0x0102030405060708,
    service=Service.SDC,
    handshake=Handshake.FRAMED,
    source="10.0.0.3",
    pairs=65_536,
    frame_bytes=256,
    rate_hz=10_000_000,
    port=7,
)
GOLDEN: list[tuple[Message, str]] = [
    (
        SETUP,
        "514d0501000000b60102030405060708"
        "01010a0000030001000000000100009896800007"
        "00000000e4000000000017a728000000000"
        "00f424000000000"
        + "0000000000"
        + "0000"
        + "00" * 96
        + "0000"
        + "00000000000000000000000000000000",
    ),
    (
        Answer(1, Reason.BUSY, "später"),
        "514d05020000001f0000000000000001" + "0005" + "0000" + "00000000" + "7370c3a4746572",
    ),
    (
        Answer(1, Reason.OK, symbols=3, encoding=0b10_11_01_00, wavelength_pm=1_550_120),
        "514d0502000000180000000000000001" + "0000" + "03b4" + "0017a728",
    ),
    (Emit(2, 3, 4, 5), "514d05030000001c0000000000000002000000030000000400000005"),
    (Emission(2, 3, 4, 5), "514d05090000001c0000000000000002000000030000000400000005"),
    (Emitted(6, 7), "514d050a00000014000000000000000600000007"),
    (
        Block(3, 1, 9, 1, 10, (Frame(6, 2, 0xDEADBEEF),)),
        "514d050400000032000000000000000300000001000000090000000100000000"
        "0000000a0001" + "0000000600000002deadbeef",
    ),
    (
        Report(4, 1, 9, 2, 3, 4, 5, (6,), b"\x80\x00"),
        "514d050500000030000000000000000400000001000000090000000200000003"
        "0000000400000005" + "0001" + "00000006" + "8000",
    ),
    (
        Finish(5, 6, bytes(range(32))),
        "514d050600000038" + f"{5:016x}{6:016x}" + bytes(range(32)).hex(),
    ),
    (
        Values(6, Topic.CORRECTIONS, 2, 9, 5, b"\xe4\x40"),
        "514d05070000001c0000000000000006" + "0502" + "0000000900000005" + "e440",
    ),
    (
        Envelope(7, 200, b"own format"),
        "514d05080000001b0000000000000007" + "c8" + b"own format".hex(),
    ),
]


class ScapySetup(Packet):
    """The set-up message, written down a second time from the layout alone."""

    name = "quantum metadata set-up"
    fields_desc = [  # noqa: RUF012 (scapy's own way)
        XShortField("magic", 0),
        XByteField("version", 0),
        XByteField("kind", 0),
        IntField("length", 0),
        LongField("session", 0),
        XByteField("service", 0),
        XByteField("handshake", 0),
        IPField("source", "0.0.0.0"),
        IntField("pairs", 0),
        IntField("frame_bytes", 0),
        IntField("rate_hz", 0),
        ShortField("port", 0),
        IntField("block", 0),
        XByteField("encoding", 0),
        XByteField("fec", 0),
        XByteField("interleave", 0),
        XByteField("polarization", 0),
        XByteField("memory", 0),
        IntField("wavelength_pm", 0),
        SignedIntField("phase_mrad", 0),
        IntField("sync_window_ps", 0),
        IntField("fidelity_ppm", 0),
        XByteField("priority", 0),
        IntField("deadline_ms", 0),
        StrFixedLenField("obstacle", b"", 96),
        XByteField("verdict", 0),
        XByteField("rotation", 0),
        ShortField("reason", 0),
        StrFixedLenField("seal", b"", 16),
    ]


@pytest.mark.parametrize(("number", "name"), [(0, "PENDING"), (1, "GRANTED"), (2, "REFUSED")])
def test_a_verdict_is_read_as_its_number_says(number: int, name: str) -> None:
    data = bytearray(SETUP.encode())
    data[-20] = number  # before rotation, reason and the 16 bytes of the seal
    setup = decode(bytes(data))
    assert isinstance(setup, Setup)
    assert setup.verdict == Verdict[name]
    assert setup.encode() == bytes(data)


@pytest.mark.parametrize(("message", "golden"), GOLDEN, ids=lambda value: type(value).__name__)
def test_golden_bytes_both_ways(message: Message, golden: str) -> None:
    assert message.encode().hex() == golden
    assert decode(bytes.fromhex(golden)) == message


def test_scapy_reads_the_same_fields() -> None:
    setup = replace(SETUP, phase_mrad=-5, verdict=Verdict.GRANTED, rotation=Pauli.Z, block=77)
    setup = replace(setup, fec=3, interleave=1, seal=bytes(range(16)))
    setup = replace(setup, obstacle="fibre q1-q2 is cut")
    seen = ScapySetup(setup.encode())
    for name in (
        "session",
        "source",
        "pairs",
        "rate_hz",
        "port",
        "block",
        "phase_mrad",
        "fec",
        "interleave",
        "seal",
    ):
        assert seen.getfieldval(name) == getattr(setup, name)
    assert (seen.verdict, seen.rotation, seen.encoding) == (1, 2, 0xE4)
    assert seen.obstacle == b"fibre q1-q2 is cut" + bytes(78)
    assert seen.length == len(setup.encode()) == SETUP_LENGTH
    assert not seen.payload


def test_a_verdict_moves_no_byte_of_the_set_up() -> None:
    granted = replace(SETUP, verdict=Verdict.GRANTED, rotation=Pauli.X, reason=Reason.OK).encode()
    assert len(granted) == SETUP_LENGTH <= 512
    differing = [i for i, (a, b) in enumerate(zip(granted, SETUP.encode(), strict=True)) if a != b]
    assert differing == [SETUP_LENGTH - 20, SETUP_LENGTH - 19]


@pytest.mark.parametrize(
    ("offset", "value", "words"),
    [
        (0, 0x52, "begins with"),
        (2, 9, "version 9"),
        (3, 99, "unknown kind 99"),
        (16, 99, "unknown service 99"),
        (17, 9, "unknown handshake 9"),
        (40, 0xE5, "does not use each operator once"),
        (42, 2, "interleave is 2, not 0 or 1"),
        (SETUP_LENGTH - 116, 10, "is not printable ASCII"),
        (SETUP_LENGTH - 116, 0xC3, "is not printable ASCII"),
        (SETUP_LENGTH - 20, 7, "unknown verdict 7"),
        (SETUP_LENGTH - 17, 200, "unknown reason 200"),
    ],
)
def test_a_wrong_field_is_named(offset: int, value: int, words: str) -> None:
    data = bytearray(SETUP.encode())
    data[offset] = value
    with pytest.raises(MalformedPacket, match=words):
        decode(bytes(data))


@pytest.mark.parametrize("name", ["pairs", "frame_bytes", "rate_hz"])
def test_zero_is_refused(name: str) -> None:
    fields: dict[str, Any] = {name: 0}
    with pytest.raises(MalformedPacket, match=f"{name} is 0"):
        decode(replace(SETUP, **fields).encode())


def test_an_absurd_length_is_refused_before_its_bytes_are_waited_for() -> None:
    header = bytearray(SETUP.encode()[:16])
    header[4:8] = b"\xff\xff\xff\xff"
    with pytest.raises(MalformedPacket, match="4294967295"):
        message_length(bytes(header))


def test_a_block_must_carry_what_it_lists() -> None:
    data = Block(3, 1, 9, 9, 10, (Frame(6, 2, 1),)).encode()
    with pytest.raises(MalformedPacket, match="do not carry"):
        decode(data)


@pytest.mark.parametrize(
    "report",
    [
        Report(4, 1, 9, 10),
        Report(4, 1, 9, 1, again=b"\xc0\x00"),
        Report(4, 1, 9, 9, again=b"\xff"),
    ],
)
def test_a_report_cannot_lose_more_pairs_than_there_were(report: Report) -> None:
    with pytest.raises(MalformedPacket, match="of block 1"):
        decode(report.encode())


@pytest.mark.parametrize(
    ("values", "words"),
    [
        (Values(6, 1, 3, 0, 2, b"\xfc"), "3 bits a value"),
        (Values(6, 1, 8, 0, 2, b"\x01"), "2 of 8 bits are not 1 bytes"),
        (Values(6, 1, 1, 0, 9, b"\x01"), "9 of 1 bits are not 1 bytes"),
        (Values(6, 1, 32, 0, 1 << 30, b""), "are not 0 bytes"),
        (Values(6, 1, 2, 0, 3, b"\x01"), "behind the last value are not 0"),
    ],
)
def test_values_are_packed_without_gaps(values: Values, words: str) -> None:
    with pytest.raises(MalformedPacket, match=words):
        decode(values.encode())


@pytest.mark.parametrize(("symbols", "encoding"), [(2, 0xE4), (5, 0xE4), (0, 0xE4), (4, 0), (3, 1)])
def test_an_answer_names_three_or_four_symbols_and_their_operators(
    symbols: int, encoding: int
) -> None:
    with pytest.raises(MalformedPacket):
        decode(Answer(1, Reason.OK, symbols=symbols, encoding=encoding).encode())


def test_numbers_of_sessions_are_their_openers() -> None:
    """10.0.0.1 in the high 32 bits; of 2^25 sessions each has 127 numbers behind it to itself."""
    assert session_number("10.0.0.1", 1) == 0x0A000001_00000080
    assert session_number("10.0.0.1", (1 << 25) + 1) == session_number("10.0.0.1", 1)
    assert session_number("10.0.0.1", 3) - session_number("10.0.0.1", 2) == 128
    for number in (session_number("10.0.0.1", 5), session_number("10.0.0.1", (1 << 25) - 1) + 127):
        assert is_number_of(number, "10.0.0.1")
        assert not is_number_of(number, "10.0.0.2")
