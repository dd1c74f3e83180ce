"""The merged timeline of a run, checked by Wireshark's own tools."""

import random
import struct
import subprocess
import time
from pathlib import Path

import pytest
from scapy.utils import PcapWriter, RawPcapReader

from dispatcher.layer.history import EventCapture
from qmn.results.timeline import (
    TIMELINE,
    WHOLE_AT_MOST_BYTES,
    NoCaptures,
    captured_bytes,
    merge,
    timeline_of_run,
)
from topologies.system.runs.runtime import EVENT_CAPTURE
from views.dissection.dissectors import PROTOCOL, SCRIPT
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


def stepped(run: Path) -> None:
    """Leave what a run leaves whose clock has leapt twice; in between, packets came in turns."""
    capture(run / "s1-eth1.pcap", [5, 10, 14, 25])
    capture(run / "s1-eth2.pcap", [12])
    capture(run / "s1-eth3.pcap", [13, 11])  # as two processors may leave them
    record(run / EVENT_CAPTURE, [event(1_000), event(2_000)])
    leaps = ((9, 1_000), (22, 2_000))  # by the wall, and to which instant
    begin_ns = START_S * 10**9
    packed = b"".join(LEAP.pack(begin_ns + wall, begin_ns + to) for wall, to in leaps)
    (run / LEAPS).write_bytes(packed + b"cut")


IN_STEPS = [
    (5, "s1-eth1", 5),
    (1_000, "dispatcher", None),
    (1_000, "s1-eth1", 10),
    (1_000, "s1-eth3", 11),
    (1_000, "s1-eth2", 12),
    (1_000, "s1-eth3", 13),
    (1_000, "s1-eth1", 14),
    (2_000, "dispatcher", None),
    (2_000, "s1-eth1", 25),
]


def in_steps(file: Path) -> list[tuple[int, str, int | None]]:
    """Return time, interface and number of each packet, which has 60 bytes."""
    names, packets = read(file)
    seen: list[tuple[int, str, int | None]] = []
    for packet in packets:
        offset_ns, name = packet.time_ns - START_S * 10**9, names[packet.interface]
        number = int.from_bytes(packet.data, "big") if name.startswith("s1") else None
        assert number is None or len(packet.data) == 60
        seen.append((offset_ns, name, number))
    return seen


def by_scapy(file: Path) -> list[tuple[int, int]]:
    """Return time and number of each packet of a capture, read by another program."""
    with RawPcapReader(str(file)) as reader:
        assert reader.nano
        return [
            ((at.sec - START_S) * 10**9 + at.usec, int.from_bytes(data, "big"))
            for data, at in reader
        ]


def test_a_packet_has_the_instant_of_the_last_leap_before_it(tmp_path: Path) -> None:
    stepped(tmp_path)
    before = {file: file.read_bytes() for file in tmp_path.glob("*.pcap")}
    assert in_steps(merge(tmp_path)) == IN_STEPS
    assert {file: file.read_bytes() for file in tmp_path.glob("*.pcap")} == before


def test_captures_of_stepped_time_get_the_times_of_the_timeline_once(tmp_path: Path) -> None:
    stepped(tmp_path)
    capture(tmp_path / "cut.pcap", [26, 27])
    (tmp_path / "cut.pcap").write_bytes((tmp_path / "cut.pcap").read_bytes()[:-1])
    capture(tmp_path / "earlier.pcap", [2, 3])  # before the first leap
    earlier = (tmp_path / "earlier.pcap").read_bytes()
    names = {file.name for file in tmp_path.iterdir()}
    timeline_of_run(tmp_path)
    for name in ("s1-eth1", "s1-eth2", "s1-eth3"):
        wanted = [(at, number) for at, where, number in IN_STEPS if where == name]
        assert by_scapy(tmp_path / f"{name}.pcap") == wanted
        assert (tmp_path / f"{name}.pcap").stat().st_mode & 0o777 == 0o600
    assert by_scapy(tmp_path / "cut.pcap") == [(2_000, 26)]
    assert (tmp_path / "earlier.pcap").read_bytes() == earlier
    left = {file: file.read_bytes() for file in tmp_path.iterdir()}
    assert {file.name for file in left} == names | {TIMELINE, SCRIPT, PROTOCOL.name}
    timeline_of_run(tmp_path)
    assert {file: file.read_bytes() for file in tmp_path.iterdir()} == left


def test_the_order_within_an_instant_stays_when_whole_packets_are_merged(tmp_path: Path) -> None:
    stepped(tmp_path)
    _names, packets = read(merge(tmp_path, packet_bytes=20, rewrite=True))
    assert {len(packet.data) for packet in packets if packet.interface < 3} == {20}
    prepare(tmp_path, whole=True)
    assert in_steps(tmp_path / TIMELINE) == IN_STEPS


def test_captures_without_the_timeline_of_their_order_are_not_merged(tmp_path: Path) -> None:
    stepped(tmp_path)
    timeline_of_run(tmp_path)
    capture(tmp_path / "s1-eth9.pcap", [7])
    with pytest.raises(MalformedPacket, match="is not of the captures beside it"):
        merge(tmp_path)
    (tmp_path / "s1-eth9.pcap").unlink()
    whole = (tmp_path / "s1-eth2.pcap").read_bytes()
    for spoiled in (whole[:-1], whole + whole[24:]):
        (tmp_path / "s1-eth2.pcap").write_bytes(spoiled)
        with pytest.raises(MalformedPacket, match="is not of the captures"):
            merge(tmp_path)
    (tmp_path / TIMELINE).unlink()
    with pytest.raises(NoCaptures, match=r"`mergecap -w all\.pcapng"):
        merge(tmp_path)


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
