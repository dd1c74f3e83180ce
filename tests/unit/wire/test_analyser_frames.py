"""Frames of Bell analysers as bytes: read as written, and hostile ones refused whole."""

import struct
from dataclasses import replace

import pytest

from wire.analyser_frames import (
    BROADCAST,
    HEAD,
    LEAST_PAYLOAD,
    MOST_OUTCOMES,
    AnalyserCounts,
    AnalyserFrame,
    Emission,
    End,
    frames_of,
)
from wire.malformed import MalformedPacket

SENDER = bytes.fromhex("020000000001")
FRAME = AnalyserFrame(60_001, 7, End.MEASURED, 5, 0, bytes([0, 1, 2, 3, 255]), 0x01020304)
BYTES = FRAME.encode(BROADCAST, SENDER)
ALONE = AnalyserFrame(60_003, 1, End.NO_PARTNER, 9)
STORED = AnalyserFrame(61_002, 3, End.STORED, 3, 0, bytes([0, 255, 0]))


HERALDED = AnalyserFrame(60_001, 7, End.HERALDED, 2, 0, bytes([1, 3]), 99)
WAITS = AnalyserFrame(60_001, 8, End.WAITS, 4)
NOTHING = AnalyserFrame(60_001, 8, End.HERALDED, 0, 0, b"", 99)
ROUND = AnalyserFrame(61_002, 4, End.PURIFY, 3, 0, bytes([11, 255, 6]), method=5)
BITS = AnalyserFrame(61_002, 5, End.PURIFIED, 3, 0, bytes([1, 255, 0]))


@pytest.mark.parametrize("frame", [FRAME, ALONE, STORED, HERALDED, WAITS, NOTHING, ROUND, BITS])
def test_a_frame_is_read_as_it_was_written(frame: AnalyserFrame) -> None:
    data = frame.encode(BROADCAST, SENDER)
    assert AnalyserFrame.decode(data) == frame
    assert len(data) == 14 + LEAST_PAYLOAD


def test_its_bytes_are_as_documented() -> None:
    payload = BYTES[14:]
    assert BYTES[:14].hex() == "ffffffffffff02000000000188b5"
    assert payload[:28].hex() == "514d4e41000000050000ea6100000007000000050000000001020304"
    assert payload[28:31].hex() == "0123f0"
    heralded, waits = (each.encode(BROADCAST, SENDER) for each in (HERALDED, WAITS))
    assert (
        heralded[12:43].hex()
        == ("88b5514d4e41070000020000ea61000000070000000200000000000000631300"[:62])
    )
    assert waits[12:42].hex() == "88b6514d4e41080000000000ea610000000800000004" + "00" * 8


def test_a_long_block_is_told_in_frames_that_ethernet_carries() -> None:
    outcomes = bytes([0, 1, 2, 255]) * MOST_OUTCOMES
    report = AnalyserFrame(60_001, 1, End.MEASURED, len(outcomes), 0, outcomes)
    frames = [each.encode(BROADCAST, SENDER) for each in frames_of(report)]
    assert max(map(len, frames)) == 1514
    assert b"".join(AnalyserFrame.decode(frame).outcomes for frame in frames) == outcomes


@pytest.mark.parametrize(
    ("place", "value"),
    [
        (12, 0x08),  # another EtherType
        (14, 0),  # another magic
        (18, 6),  # an end that there is not
        (18, 1),  # no partner, but outcomes
        (18, 5),  # stored, but of another type
        (13, 0xB6),  # a herald of what was measured
        (19, 1),  # where 0 is
        (21, 0),  # no outcomes of light that was measured
        (21, 6),  # more outcomes than pulses
        (20, 0xFF),  # more than any frame has
        (33, 4),  # fewer pulses than outcomes
        (37, 1),  # beyond the last pulse
        (42, 0x41),  # no Bell state
        (44, 0xF1),  # more than the last outcome
        (50, 1),  # in the padding
    ],
)
def test_hostile_bytes_are_refused(place: int, value: int) -> None:
    spoilt = BYTES[:place] + bytes([value]) + BYTES[place + 1 :]
    with pytest.raises(MalformedPacket):
        AnalyserFrame.decode(spoilt)


@pytest.mark.parametrize(
    ("place", "value"),
    [
        (18, 5),  # a herald with a method
        (19, 1),  # no method
        (19, 6),
        (19, 0),  # no round, but thirds of a turn
        (42, 0xCF),  # more than two of them
    ],
)
def test_hostile_rounds_are_refused(place: int, value: int) -> None:
    data = ROUND.encode(BROADCAST, SENDER)
    assert data[42:44].hex() == "bf60"
    with pytest.raises(MalformedPacket):
        AnalyserFrame.decode(data[:place] + bytes([value]) + data[place + 1 :])


def test_ports_numbers_and_sizes_of_nothing_are_refused() -> None:
    for change in ((0, 7, 5), (60_001, 0, 5), (60_001, 7, 0), (60_001, 7, 1 << 25)):
        fixed = b"QMNA", End.CLOSED, 0, 0, *change, 0, 0
        payload = HEAD.pack(*fixed).ljust(LEAST_PAYLOAD, b"\0")
        with pytest.raises(MalformedPacket):
            AnalyserFrame.decode(BYTES[:14] + payload)


def test_counts_add_up_and_are_written_in_their_order() -> None:
    counts = AnalyserCounts(60_001)
    ends = [AnalyserFrame(60_001, 8, end, 2) for end in (End.UNFIT, End.FAILED, End.WAITS)]
    many = replace(HERALDED, waited_us=1 << 40)
    for report in (FRAME, ALONE, *ends, HERALDED, many, NOTHING):
        attempts = report.waited_us if report.end == End.HERALDED else 0
        counts.add(report.end, report.outcomes, attempts)
    numbers = struct.unpack("!I4x11Q", counts.encode())
    assert numbers == (60_001, 9, 1, 3, 1, 3, 1, 1, 0, 1, 1, 198 + (1 << 40))
    assert AnalyserFrame.decode(many.encode(BROADCAST, SENDER)).waited_us == (1 << 32) - 1


def test_what_a_source_emits_by_is_read_as_written_and_hostile_bytes_are_refused() -> None:
    emission = Emission(7, 3, 100, 50_000_000, 193_400_000)
    data = emission.encode()
    assert (Emission.decode(data), len(data)) == (emission, 14 + LEAST_PAYLOAD)
    for place in (12, 14, 42, 59):
        with pytest.raises(MalformedPacket):
            Emission.decode(data[:place] + bytes([data[place] ^ 1]) + data[place + 1 :])
    with pytest.raises(MalformedPacket):
        Emission.decode(data[:-1])
    with pytest.raises(MalformedPacket, match=r"07000000030{8}02faf080"):
        Emission.decode(replace(emission, pairs=0).encode())
