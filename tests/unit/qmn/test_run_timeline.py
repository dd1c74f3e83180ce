"""The merged timeline of a run, checked by Wireshark's own tools."""

import random
import struct
import subprocess
import time
from pathlib import Path

import pytest
from scapy.utils import PcapWriter

from dispatcher.layer.history import EventCapture
from qmn.results.timeline import (
    WHOLE_AT_MOST_BYTES,
    NoCaptures,
    captured_bytes,
    merge,
    timeline_of_run,
)
from topologies.system.runs.runtime import EVENT_CAPTURE
from views.events.event_sources import recorded
from views.verbs.wireshark import prepare
from wire.config import Fiber, FiberEnd
from wire.dispatcher_pb2 import Event
from wire.events import decode_record
from wire.leaps import LEAP, LEAPS
from wire.malformed import MalformedPacket
from wire.pcapng import Packet, Reader

START_S = 1_700_000_000
FIBERS = [
    Fiber(FiberEnd("alice", "alice-q0"), FiberEnd("q1", "2")),
    Fiber(FiberEnd("q1", "3"), FiberEnd("q2", "4")),
]


def capture(file: Path, offsets_ns: list[int]) -> None:
    with PcapWriter(str(file), linktype=1, nano=True) as writer:
        writer.write_header(None)
        for offset in offsets_ns:
            frame = offset.to_bytes(60, "big")
            writer.write_packet(frame, sec=START_S, usec=offset, caplen=60)


def record(file: Path, events: list[Event]) -> None:
    with file.open("wb") as opened:
        event_capture = EventCapture(opened, FIBERS)
        for event in events:
            event_capture.record(event)


def event(offset_ns: int, node: str = "alice", port: str = "", detail: str = "") -> Event:
    time_ns = START_S * 10**9 + offset_ns
    return Event(time_ns=time_ns, node=node, kind="send", port=port, detail=detail)


def read(file: Path) -> tuple[list[str], list[Packet]]:
    with file.open("rb") as opened:
        reader = Reader(opened)
        packets = list(reader.packets())
    return [interface.name for interface in reader.interfaces], packets


def test_a_packet_has_the_instant_of_the_last_leap_before_it(tmp_path: Path) -> None:
    capture(tmp_path / "s1-eth1.pcap", [5, 10, 25])
    capture(tmp_path / "s1-eth2.pcap", [20])
    record(tmp_path / EVENT_CAPTURE, [event(1_000), event(2_000)])
    leaps = ((9, 1_000), (22, 2_000))  # by the wall, and to which instant
    begin_ns = START_S * 10**9
    packed = b"".join(LEAP.pack(begin_ns + wall, begin_ns + to) for wall, to in leaps)
    (tmp_path / LEAPS).write_bytes(packed + b"cut")
    names, packets = read(merge(tmp_path))
    assert [(packet.time_ns - begin_ns, names[packet.interface]) for packet in packets] == [
        (5, "s1-eth1"),
        (1_000, "dispatcher"),
        (1_000, "s1-eth1"),
        (1_000, "s1-eth2"),
        (2_000, "dispatcher"),
        (2_000, "s1-eth1"),
    ]


def test_packets_and_events_are_in_time_order_on_named_interfaces(tmp_path: Path) -> None:
    capture(tmp_path / "s1-eth1.pcap", [10, 5, 30])  # as two processors may leave them
    capture(tmp_path / "s1-eth2.pcap", [20])
    events = [event(25, port="alice-q0"), event(7), event(8, "q1", "2"), event(9, "q2", "4")]
    record(tmp_path / EVENT_CAPTURE, events)
    file = merge(tmp_path)
    assert file == tmp_path / "all.pcapng"
    names, packets = read(file)
    seen = [(packet.time_ns - START_S * 10**9, names[packet.interface]) for packet in packets]
    assert seen == [
        (5, "s1-eth1"),
        (7, "dispatcher"),
        (8, "fiber alice-q0"),
        (9, "fiber q1:3 q2:4"),
        (10, "s1-eth1"),
        (20, "s1-eth2"),
        (25, "fiber alice-q0"),
        (30, "s1-eth1"),
    ]
    for packet, (offset, name) in zip(packets, seen, strict=True):
        if name.startswith("s1"):
            assert int.from_bytes(packet.data, "big") == offset
        else:
            assert decode_record(packet.data).time_ns == packet.time_ns
    assert [event.time_ns % 10**9 for event in recorded(file, follow=False)] == [7, 8, 9, 25]
    info = subprocess.run(["capinfos", file], capture_output=True, text=True, check=True)
    assert info.stderr == ""
    assert "Strict time order:   True" in info.stdout
    assert {path.name for path in tmp_path.iterdir()} == {
        "s1-eth1.pcap",
        "s1-eth2.pcap",
        EVENT_CAPTURE,
        "all.pcapng",
    }


def test_the_timeline_of_a_long_run_has_the_heads_of_packets(tmp_path: Path) -> None:
    few = [bytes([number]) * 1_500 for number in range(9)]
    written(tmp_path / "s1-eth1.pcap", few)
    record(tmp_path / EVENT_CAPTURE, [event(number, detail="x" * 300) for number in range(5)])
    assert timeline_of_run(tmp_path) == str(tmp_path / "all.pcapng")
    assert packets_of(tmp_path) == few
    many = [bytes([number % 256]) * 1_500 for number in range(WHOLE_AT_MOST_BYTES // 1_500 + 1)]
    written(tmp_path / "s1-eth1.pcap", many)
    timeline_of_run(tmp_path)
    assert packets_of(tmp_path) == [packet[:128] for packet in many]
    assert [event.detail for event in recorded(tmp_path / "all.pcapng", False)] == ["x" * 300] * 5
    prepare(tmp_path, whole=True)
    assert packets_of(tmp_path) == many


def written(file: Path, packets: list[bytes]) -> None:
    """Write packets as tcpdump does: little-endian, nanoseconds, a nanosecond apart."""
    head = struct.pack("<IHHiIII", 0xA1B23C4D, 2, 4, 0, 0, 65_600, 1)
    body = [
        struct.pack("<IIII", START_S, number, len(data), len(data)) + data
        for number, data in enumerate(packets)
    ]
    file.write_bytes(head + b"".join(body))


def packets_of(run: Path) -> list[bytes]:
    """Return the packets of a run's timeline that are no events; each knows how long it was."""
    names, packets = read(run / "all.pcapng")
    own = [packet for packet in packets if names[packet.interface] == "s1-eth1"]
    assert {packet.length for packet in own} == {1_500}
    return [packet.data for packet in own]


def test_what_was_cut_off_is_left_out(tmp_path: Path) -> None:
    capture(tmp_path / "a.pcap", [1, 2])
    (tmp_path / "empty.pcap").touch()
    record(tmp_path / EVENT_CAPTURE, [event(3), event(4)])
    for name in ("a.pcap", EVENT_CAPTURE):
        whole = (tmp_path / name).read_bytes()
        (tmp_path / name).write_bytes(whole[:-1])
    _names, packets = read(merge(tmp_path))
    assert [packet.time_ns % 10**9 for packet in packets] == [1, 3]


def test_a_capture_without_packets_keeps_its_interface(tmp_path: Path) -> None:
    capture(tmp_path / "a.pcap", [])
    record(tmp_path / EVENT_CAPTURE, [])
    names, packets = read(merge(tmp_path))
    assert names == ["a", "dispatcher", "fiber alice-q0", "fiber q1:3 q2:4"]
    assert packets == []


def test_nothing_to_merge_is_said(tmp_path: Path) -> None:
    with pytest.raises(NoCaptures, match="no captures in"):
        merge(tmp_path)
    (tmp_path / "a.pcap").write_bytes(b"no capture at all" * 9)
    with pytest.raises(MalformedPacket):
        merge(tmp_path)
    assert not (tmp_path / "all.pcapng").exists()


def test_as_many_packets_as_of_a_mebibyte_take_seconds(tmp_path: Path) -> None:
    draw = random.Random(1)
    for name in "abcd":
        capture(tmp_path / f"{name}.pcap", sorted(draw.randrange(10**9) for _ in range(10_000)))
    before = time.process_time()
    _names, packets = read(merge(tmp_path))
    assert time.process_time() - before < 5
    assert len(packets) == 40_000
    assert captured_bytes(tmp_path) == 4 * (24 + 10_000 * 76)
