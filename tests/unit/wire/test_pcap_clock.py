"""Captures of another machine, whose clock is ahead or behind."""

import struct
from io import BytesIO
from pathlib import Path

import pytest
from scapy.layers.l2 import Ether
from scapy.utils import RawPcapReader

from wire.malformed import MalformedPacket
from wire.pcapng import with_clock

FRAME = bytes(Ether(dst="02:00:00:00:00:01", src="02:00:00:00:00:02") / b"light")
SECONDS, NANOSECONDS = 1_700_000_000, 5


def capture(magic: int) -> BytesIO:
    """Return a file of one packet, as libpcap's format describes it."""
    head = struct.pack(">IHHiIII", magic, 2, 4, 0, 0, 65535, 1)
    return BytesIO(head + struct.pack(">IIII", SECONDS, NANOSECONDS, len(FRAME), 99) + FRAME)


@pytest.mark.parametrize(
    ("ahead_ns", "expected"),
    [(0, (SECONDS, 5)), (7, (SECONDS - 1, 999_999_998)), (-(10**9), (SECONDS + 1, 5))],
)
def test_packets_get_the_time_of_the_other_clock(
    ahead_ns: int, expected: tuple[int, int], tmp_path: Path
) -> None:
    file = tmp_path / "there.pcap"
    with file.open("wb") as target:
        with_clock(capture(0xA1B23C4D), target, ahead_ns)
    with RawPcapReader(str(file)) as reader:
        ((data, about),) = list(reader)
        assert reader.nano
        assert reader.linktype == 1
    assert (about.sec, about.usec) == expected
    assert (data, about.caplen, about.wirelen) == (FRAME, len(FRAME), 99)


def test_microseconds_become_nanoseconds() -> None:
    target = BytesIO()
    with_clock(capture(0xA1B2C3D4), target, 0)
    assert struct.unpack_from("<II", target.getvalue(), 24) == (SECONDS, 5_000)


def test_what_is_no_capture_is_refused() -> None:
    with pytest.raises(MalformedPacket):
        with_clock(BytesIO(b"no capture at all, but long enough"), BytesIO(), 0)
