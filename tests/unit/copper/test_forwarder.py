"""Copper holds every packet for as long as it is long, and none of the simulation's own."""

import resource
import select
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from ipaddress import IPv4Address
from itertools import chain
from pathlib import Path
from threading import Thread

import pytest
from limits import SOON_S
from stepping import SINCE_NS, stepping

from copper.acknowledgements import FEW
from copper.forwarder import QUEUE_BYTES, Direction, Forwarder, Software
from wire.config import Cable, CopperConfig
from wire.network_time import NEVER, GateClient

ALICE, BOB, ED = (IPv4Address(f"10.0.0.{number}").packed for number in (1, 2, 4))
NEVER_S = 1e6


def ip(source: bytes, target: bytes, payload: bytes = b"") -> bytes:
    """Return an Ethernet frame with an IPv4 header, whose addresses are all that matters."""
    return bytes(12) + b"\x08\x00" + b"\x45" + bytes(11) + source + target + payload


def tcp(payload: bytes = b"", ends: bytes = ALICE + BOB, number: int = 0, ack: int = 0) -> bytes:
    """Return a frame of a TCP connection; its port is 0 at both ends."""
    header = b"\x45\0" + (40 + len(payload)).to_bytes(2) + bytes(5) + b"\x06" + bytes(2) + ends
    numbers = bytes(4) + number.to_bytes(4) + ack.to_bytes(4)
    return bytes(12) + b"\x08\x00" + header + numbers + b"\x50\x10" + bytes(6) + payload


def arp(sender: bytes, target: bytes) -> bytes:
    return bytes(12) + b"\x08\x06" + bytes(14) + sender + bytes(6) + target


@contextmanager
def cables(
    *delays_s: float,
    scale: float = 1.0,
    loss: float = 0.0,
    mbps: float | None = None,
    time_folder: str = "",
    software: str = "",
) -> Iterator[list[tuple[socket.socket, ...]]]:
    """Run copper; yield the far sides of both ends of each cable, which are packet sockets."""
    kind = socket.AF_UNIX, socket.SOCK_SEQPACKET
    pairs = [(socket.socketpair(*kind), socket.socketpair(*kind)) for _ in delays_s]
    laid = [
        Cable(
            "a", "b", one[0].detach(), other[0].detach(), delay_s, loss, mbps, b_software=software
        )
        for (one, other), delay_s in zip(pairs, delays_s, strict=True)
    ]
    forwarder = Forwarder(CopperConfig(laid, "10.0.0.4", time_scale=scale, time_folder=time_folder))
    thread = Thread(target=forwarder.run, daemon=True)
    thread.start()
    try:
        yield [(one[1], other[1]) for one, other in pairs]
    finally:
        forwarder.stop()
        thread.join(SOON_S)
        assert not thread.is_alive()
        forwarder.close()
        for far in (end[1] for pair in pairs for end in pair):
            far.settimeout(SOON_S)
            while far.recv(1 << 16):  # what was on its way; then the end of all
                pass
            far.close()


def comes(end: socket.socket) -> bytes:
    end.settimeout(SOON_S)
    return end.recv(1 << 16)


@pytest.mark.parametrize("backwards", [False, True])
def test_a_packet_is_never_earlier_than_the_cable_is_long(backwards: bool) -> None:
    with cables(0.05) as [ends]:
        near, far = reversed(ends) if backwards else ends
        for number in range(5):
            sent_s = time.monotonic()
            near.send(ip(ALICE, BOB, bytes([number])))
            assert comes(far) == ip(ALICE, BOB, bytes([number]))
            assert time.monotonic() - sent_s >= 0.05


def test_the_delay_is_of_the_network() -> None:
    with cables(0.001, scale=80.0) as [(near, far)]:
        sent_s = time.monotonic()
        near.send(ip(ALICE, BOB))
        comes(far)
        assert time.monotonic() - sent_s >= 80 * 0.001


def test_a_packet_takes_stepped_time_to_the_nanosecond_and_none_of_the_wall() -> None:
    with stepping() as gate, cables(3_600.0, time_folder=gate.time.folder) as [(near, far)]:
        near.send(ip(ALICE, BOB))
        assert comes(far) == ip(ALICE, BOB)
        assert gate.time.now_s() == 3_600


def test_the_clock_leaps_for_acknowledgements_of_many_segments_alone() -> None:
    """A connection may have ten under way: who has sent a few waits for none of them."""
    with stepping() as gate, cables(1.0, time_folder=gate.time.folder) as [(near, far)]:
        at_s, number = 0.0, 0xFFFFFFFE  # which begins again at zero
        for segments in (1, FEW, FEW + 1):
            for _ in range(segments):
                near.send(tcp(b"x", number=number))
                number = (number + 1) % 2**32
            for _ in range(segments):
                comes(far)
            while select.select([near], [], [], 0)[0]:  # what was held before
                comes(near)
            far.send(tcp(ends=BOB + ALICE, ack=number))
            at_s += 1
            assert gate.time.now_s() == at_s
            assert bool(select.select([near], [], [], 0.05)[0]) == (segments > FEW)


def test_an_acknowledgement_arrives_though_nobody_waits_for_anything_else() -> None:
    """As when a sender holds its second small segment back until then (Nagle, RFC 896)."""
    with stepping() as gate, cables(1.0, time_folder=gate.time.folder) as [(near, far)]:
        near.send(tcp(b"x"))
        comes(far)
        far.send(tcp(ends=BOB + ALICE, ack=1))
        comes(near)
        assert gate.time.now_s() == 2


def test_the_clock_stops_for_an_acknowledgement_on_its_way_to_a_timeout() -> None:
    with (
        stepping() as gate,
        cables(1.0, time_folder=gate.time.folder) as [(near, far)],
        closing(GateClient(gate.time)) as client,
    ):
        near.send(tcp(b"x"))
        comes(far)
        client.wait_for(SINCE_NS + 45 * 10**9)
        far.send(tcp(ends=BOB + ALICE, ack=1))
        comes(near)
        assert gate.time.now_s() == 2


def test_the_background_takes_no_time_unless_packets_are_before_it() -> None:
    with (
        stepping() as gate,
        cables(1.0, time_folder=gate.time.folder) as [(near, far)],
        closing(GateClient(gate.time)) as polling,
    ):
        gate.time.begin()
        for before in ([], [tcp(b"x")]):
            while gate.time.in_background:  # until the gate has seen that nothing runs
                time.sleep(0.001)
            for frame in before:
                near.send(frame)
            polling.wait_for(NEVER, gate.time.now_ns())
            assert polling.take_notice()
            near.send(tcp(b"poll"))
            assert [comes(far) for _ in (*before, 0)] == [*before, tcp(b"poll")]
            assert gate.time.now_s() == len(before)


def test_software_gets_bytes_of_tcp_after_its_time_and_the_kernel_the_rest_at_once() -> None:
    with (
        stepping() as gate,
        cables(1.0, time_folder=gate.time.folder, software="5ms") as [(near, far)],
    ):
        for sent, at_s in ((tcp(), 1.0), (ip(ALICE, BOB), 2.0), (tcp(b"x"), 3.005)):
            near.send(sent)
            assert comes(far) == sent
            assert gate.time.now_s() == at_s
        far.send(tcp(b"y"))  # no software was stated for the other end
        assert comes(near) == tcp(b"y")
        assert gate.time.now_s() == 4.005


def test_messages_that_are_handled_at_once_come_in_order_at_different_instants() -> None:
    """Else their order could be changed where all of one instant is gathered and sorted."""
    software = Software("9ns", "")
    assert [software.handled_ns(arrived_ns) for arrived_ns in (1, 1, 3)] == [10, 11, 12]


def test_what_a_message_takes_does_not_depend_on_those_before_it() -> None:
    """Polls, whose number the machine may change, come by the same cable."""
    instants = range(10**9, 10**11, 10**9)  # ten means apart: rarely does one overtake another
    all_ns = [Software("uniform(1ms,100ms)", "1 c0").handled_ns(each) for each in instants]
    software = Software("uniform(1ms,100ms)", "1 c0", 7)
    assert [software.handled_ns(each + 7) - 7 for each in instants] == all_ns
    assert len({taken - each for taken, each in zip(all_ns, instants, strict=True)}) == len(all_ns)


def test_messages_in_a_queue_are_handled_one_after_the_other() -> None:
    software = Software("queued(9ns)", "")
    assert [software.handled_ns(arrived_ns) for arrived_ns in (1, 2, 50)] == [10, 19, 59]


def test_packets_come_out_in_order_and_none_is_lost() -> None:
    with cables(0.01) as [(near, far)]:
        frames = [ip(ALICE, BOB, number.to_bytes(2, "big")) for number in range(100)]
        for frame in frames:
            near.send(frame)
        assert [comes(far) for _ in frames] == frames


def test_a_long_cable_does_not_keep_a_short_one_waiting() -> None:
    with cables(NEVER_S, 0.001) as [(slow, end), (quick, far)]:
        slow.send(ip(ALICE, BOB))
        quick.send(ip(ALICE, BOB))
        assert comes(far) == ip(ALICE, BOB)
        assert not select.select([end], [], [], 0)[0]


@pytest.mark.parametrize("frame", [ip(ALICE, ED), ip(ED, ALICE), arp(ALICE, ED), arp(ED, ALICE)])
def test_what_the_simulation_says_is_held_by_no_cable(frame: bytes) -> None:
    with cables(NEVER_S) as [(near, far)]:
        near.send(frame)
        assert comes(far) == frame


@pytest.mark.parametrize("frame", [ip(ALICE, BOB), arp(BOB, ALICE), b"\0", ED * 4, bytes(60)])
def test_all_else_is_held_whatever_is_in_it(frame: bytes) -> None:
    """The packet behind it shows that the frame has been read by then."""
    with cables(NEVER_S) as [(near, far)]:
        near.send(frame)
        near.send(ip(ALICE, ED))
        assert comes(far) == ip(ALICE, ED)
        assert not select.select([far], [], [], 0)[0]


def test_an_end_that_is_gone_loses_packets_and_nothing_else() -> None:
    with cables(0.001, 0.001) as [(near, far), (other, there)]:
        far.shutdown(socket.SHUT_RDWR)
        near.send(ip(ALICE, BOB))
        other.send(ip(ALICE, BOB))
        assert comes(there) == ip(ALICE, BOB)


def test_a_lossy_cable_loses_its_share_and_none_of_the_simulation() -> None:
    """Of 2,000 packets 30 % are lost, within five standard errors; the last one is not held."""
    with cables(0.0, loss=0.3) as [(near, far)]:
        came = 0
        for _ in range(2000):
            near.send(ip(ALICE, BOB))
            came += len(select.select([far], [], [], 0)[0]) and len(comes(far)) > 0
        near.send(ip(ALICE, ED))
        while comes(far) != ip(ALICE, ED):
            came += 1
    assert abs(came - 1400) < 5 * (2000 * 0.3 * 0.7) ** 0.5


def test_packets_on_a_slow_cable_queue_behind_each_other() -> None:
    """Ten frames of 1,250 bytes at 1 Mbit/s take 10 ms each, however fast they come."""
    with cables(0.02, mbps=1.0) as [(near, far)]:
        began_s = time.monotonic()
        for number in range(10):
            near.send(ip(ALICE, BOB, bytes([number]) * (1250 - 34)))
        for number in range(10):
            assert comes(far)[-1] == number
            assert time.monotonic() - began_s >= 0.02 + 0.01 * (number + 1)


def test_packets_for_which_a_slow_cable_has_no_room_are_lost() -> None:
    """It would take ten seconds a byte: the first waits to be sent for long, others behind it."""
    way = Direction(-1, -1, 0, 0.0, 1e10)
    lost = [way.due_ns(QUEUE_BYTES // 4, 0) is None for _ in range(7)]
    assert lost == [False] * 5 + [True] * 2
    assert way.due_ns(0, round(1.1e10 * QUEUE_BYTES)) is not None, "there is room again"


@pytest.mark.parametrize("number", [1, 600])
def test_a_network_may_have_many_cables(number: int, tmp_path: Path) -> None:
    """The files of 600 cables have numbers beyond FD_SETSIZE (1,024) of select(2)."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (max(soft, min(hard, 8 * number)), hard))
    kind = socket.AF_UNIX, socket.SOCK_SEQPACKET
    ends = [socket.socketpair(*kind) for _ in range(2 * number)]
    files = [end[0].fileno() for end in ends]
    laid = [
        Cable("a", "b", one, other, 0.02)
        for one, other in zip(files[::2], files[1::2], strict=True)
    ]
    config = tmp_path / "copper.json"
    CopperConfig(laid, "10.0.0.4").write(config)
    command = [sys.executable, "-m", "copper", "--config", str(config)]
    copper = subprocess.Popen(command, pass_fds=files, stdout=subprocess.PIPE, text=True)
    try:
        assert copper.stdout is not None
        assert copper.stdout.readline() == "ready\n"
        sent_s = time.monotonic()
        for near, _far in zip(ends[::2], ends[1::2], strict=True):
            near[1].send(ip(ALICE, BOB))
        assert {comes(far[1]) for far in ends[1::2]} == {ip(ALICE, BOB)}
        assert time.monotonic() - sent_s >= 0.02
        copper.terminate()
        output, _ = copper.communicate(timeout=SOON_S)
        assert output == f"stopped: {number:,} packets held, 0 lost\n"
    finally:
        copper.kill()
        copper.wait(SOON_S)
        for end in chain(*ends):
            end.close()
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))
