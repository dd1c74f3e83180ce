"""Captures: the command, its last words about itself, and those of another machine."""

import struct
import subprocess
from io import BytesIO
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from topologies.networks.captures import Captures, capture_command, longest, packets_missed
from topologies.system.open_vswitch import openvswitch
from topologies.system.processes.programs import NetworkError
from topologies.system.runs import runtime
from topologies.system.runs.runtime import Runtime
from wire.pcapng import PcapReader


def test_packets_that_the_kernel_dropped_are_counted() -> None:
    words = "4007 packets captured\n4008 packets received by filter\n{} dropped by kernel\n"
    assert packets_missed(words.format("0 packets")) == 0
    assert packets_missed(words.format("1 packet")) == 1
    assert packets_missed(words.format("1436 packets")) == 1436
    assert packets_missed("tcpdump: listening on lo") == 0


def test_a_capture_takes_whole_packets_at_once_and_interrupts_nobody() -> None:
    command = capture_command("s1-eth1", Path("s1-eth1.pcap"))
    assert command[:4] == ["chrt", "--batch", "0", "tcpdump"]
    assert {"-U", "--immediate-mode", "--time-stamp-precision=nano"} <= set(command)
    # Of Linux: 65,536 - 320 - 1 bytes of TCP at once, after 14 of Ethernet, 20 of IPv4, 60 of TCP.
    # Before that, in a slot of 64 KiB: tpacket2_hdr (32 bytes), sockaddr_ll (20) and a tag of VLANs
    # (4), in multiples of 16 (Documentation/networking/packet_mmap.rst).
    assert 65_215 + 94 <= int(command[command.index("-s") + 1]) <= 65_536 - 80
    assert command[-4:] == ["-i", "s1-eth1", "-w", "s1-eth1.pcap"]


def test_an_interface_that_was_deleted_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(openvswitch, "datapath", lambda: "netdev")
    with pytest.raises(NetworkError, match="the interface s1-gone was deleted at the start"):
        longest("s1-gone")


def pcap(time_s: float) -> bytes:
    """Return a capture of one packet, by nanoseconds (pcap-savefile(5))."""
    seconds, rest = divmod(round(time_s * 1e9), 10**9)
    head = struct.pack("=IHHiIII", 0xA1B23C4D, 2, 4, 0, 0, 262_144, 1)
    return head + struct.pack("=IIII", seconds, rest, 3, 3) + b"abc"


def test_a_capture_of_another_machine_comes_back_by_the_clock_of_this_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(runtime, "RUNTIME_ROOT", tmp_path / "qmn")
    captures = Captures(Runtime(log_folder=tmp_path))
    machine: Any = SimpleNamespace(
        lost=False,
        start=lambda *_: subprocess.Popen(["sleep", "60"]),
        get=lambda _path: pcap(1_000.75),
        clock_offset=lambda: SimpleNamespace(offset_s=0.5),
    )
    file = captures.begin_elsewhere(machine, "bob-eth0", 7)
    assert file.read_bytes() == b""
    captures.end()
    (packet,) = PcapReader(BytesIO(file.read_bytes())).packets()
    assert (packet.time_ns, packet.data) == (1_000_250_000_000, b"abc")
