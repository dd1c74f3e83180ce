"""q0 of alice and bob over whole stacks and a real dispatcher; a queue is in the kernel's place."""

import asyncio
import queue
import time
from collections.abc import Callable
from dataclasses import replace
from ipaddress import ip_address
from pathlib import Path
from typing import Any, cast

import pytest
from limits import SOON_S, wait_until
from scapy.layers.inet import ICMP, IP
from scapy.layers.inet6 import ICMPv6DestUnreach, ICMPv6EchoRequest, IPv6
from stacks_scene import PORTS, QNICS, Judge, grant, live_qubits, network

from applications.ip_over_light.format import PACKETS_PORT, IpOverLightConfig, Neighbor
from applications.ip_over_light.interface import Interface
from applications.ip_over_light.ip_packet import decode
from applications.ip_over_light.outgoing import MOST_QUEUED_BYTES
from applications.ip_over_light.tun import Tun
from hosts import network_loop
from hosts.quantum_socket import QuantumSocket
from hosts.stack import Stack
from wire.metadata.setup import Setup
from wire.metadata.vocabulary import Reason, Verdict

ALICE, BOB = "10.1.0.1", "10.1.0.2"
LIGHT = {"alice": ALICE, "bob": BOB}
LIGHT6 = {"alice": "fd71:6d6e::1", "bob": "fd71:6d6e::2"}
ROUTER6 = "fd71:6d6e::ffff"
OF_ALICE = {ip_address(ALICE), ip_address(LIGHT6["alice"])}
FIBERS = {**QNICS, "alice": ["alice-q0", "alice-q1"]}
NUMBERS = {**PORTS, "alice-q1": 8}
PATHS = [(4, 1), (5, 2), (1, 3), (2, 8)]  # of a session of alice to bob, and of its return
MTU = 1500
IDLE_S = 0.5


class Kernel:
    """A TUN device, as a program sees it."""

    def __init__(self) -> None:
        self.sends: queue.SimpleQueue[bytes] = queue.SimpleQueue()
        self._received: queue.SimpleQueue[bytes] = queue.SimpleQueue()

    def read(self) -> bytes:
        return self.sends.get()

    def write(self, packet: bytes) -> None:
        self._received.put(packet)

    def received(self) -> IP:
        return IP(self._received.get(timeout=SOON_S))

    @property
    def quiet(self) -> bool:
        return self._received.empty()


class Scene:
    """Both ends."""

    def __init__(self, folder: Path, stacks: dict[str, Stack], time_scale: float = 1.0) -> None:
        self.kernels = {name: Kernel() for name in LIGHT}
        self.failed: list[BaseException] = []
        self._stacks = stacks
        self.interfaces = {
            name: Interface(config(folder, name, time_scale), cast(Tun, kernel), self.failed.append)
            for name, kernel in self.kernels.items()
        }

    def ping(self, sender: str = "alice", size: int = 56, **header: Any) -> bytes:
        other = "bob" if sender == "alice" else "alice"
        ends = {"src": LIGHT[sender], "dst": LIGHT[other], **header}
        packet = bytes(IP(**ends) / ICMP() / bytes(size))
        self.kernels[sender].sends.put(packet)
        return packet

    def wait_until_idle(self) -> None:
        """Wait until neither host takes part in a session."""
        active = [self._stacks[name].active_sessions for name in LIGHT]
        wait_until(lambda: not any(each.sessions for each in active), "light is given back")


def config(folder: Path, name: str, time_scale: float = 1.0) -> IpOverLightConfig:
    return IpOverLightConfig(
        host=name,
        stack=str(folder / f"{name}.sock"),
        address=LIGHT[name],
        prefix_length=16,
        router="10.1.255.254",
        # A stack knows of its peer what the relay's connection comes from.
        neighbors=[
            Neighbor(other, "127.0.0.1", LIGHT[other], LIGHT6[other])
            for other in LIGHT
            if other != name
        ],
        address6=LIGHT6[name],
        router6=ROUTER6,
        mtu=MTU,
        idle_s=IDLE_S,
        patience_s=0.5,
        time_scale=time_scale,
    )


def with_scene(
    folder: Path,
    work: Callable[[Scene], None],
    judge: Judge = grant,
    time_scale: float = 1.0,
    **physics: Any,
) -> None:
    """Do something with both ends; in the end no photon may be left."""

    async def run() -> int:
        stacks: dict[str, Stack] = {}
        words = {"paths": PATHS, "qnics": FIBERS, "ports": NUMBERS, "stacks": stacks, **physics}
        async with network(folder, judge, **words):
            scene = Scene(folder, stacks, time_scale)
            for interface in scene.interfaces.values():
                await asyncio.to_thread(interface.start)
            await asyncio.to_thread(work, scene)
            assert not scene.failed
            await asyncio.to_thread(scene.wait_until_idle)
            live = await live_qubits(folder)
            for interface in scene.interfaces.values():
                interface.close()
            return live

    assert network_loop.run(run()) == 0


def test_packets_go_both_ways_as_they_are(tmp_path: Path) -> None:
    def work(scene: Scene) -> None:
        for sender, receiver in (("alice", "bob"), ("bob", "alice"), ("alice", "bob")):
            for size in (0, 56, MTU - 28):
                packet = scene.ping(sender, size)
                assert bytes(scene.kernels[receiver].received()) == packet

    with_scene(tmp_path, work)


def test_both_have_light_at_once_and_neither_loses_anything_to_noise(tmp_path: Path) -> None:
    def work(scene: Scene) -> None:
        # The first one has the light: here no controller keeps the other from having the same.
        scene.ping()
        scene.kernels["bob"].received()
        sent = {name: [scene.ping(name, size) for size in range(40)] for name in LIGHT}
        for name, other in (("alice", "bob"), ("bob", "alice")):
            got = [bytes(scene.kernels[other].received()) for _packet in sent[name]]
            assert got == sent[name]

    # A full frame has 1,024 pairs, of which each passes four fibres: 0.3 errors a frame.
    with_scene(tmp_path, work, depolarizing=0.0001, loss_db_per_km=0.5, length_km=1.0)


def test_light_is_had_again_when_it_was_given_back(tmp_path: Path) -> None:
    def work(scene: Scene) -> None:
        for sender, receiver in (("alice", "bob"), ("alice", "bob")):
            packet = scene.ping(sender)
            assert bytes(scene.kernels[receiver].received()) == packet
            scene.wait_until_idle()

    with_scene(tmp_path, work)


def test_who_has_no_q0_is_told_by_the_router(tmp_path: Path) -> None:
    def work(scene: Scene) -> None:
        lost = scene.ping(dst="10.1.0.9")
        error = scene.kernels["alice"].received()
        assert (error.src, error.dst) == ("10.1.255.254", ALICE)
        assert (error[ICMP].type, error[ICMP].code) == (3, 7)
        assert bytes(error)[28:] == lost

    with_scene(tmp_path, work)


@pytest.mark.parametrize(
    ("reason", "code"),
    [(Reason.NOT_ALLOWED, 13), (Reason.NO_PATH, 0), (Reason.BUSY, 1), (Reason.HARDWARE, 1)],
)
def test_a_refusal_is_told_to_every_packet_that_waits(
    tmp_path: Path, reason: Reason, code: int
) -> None:
    def refuse(setup: Setup) -> Setup:
        return replace(setup, verdict=Verdict.REFUSED, reason=reason)

    def work(scene: Scene) -> None:
        lost = {scene.ping(size=size) for size in range(5)}
        errors = [scene.kernels["alice"].received() for _packet in lost]
        assert {(error[ICMP].type, error[ICMP].code) for error in errors} == {(3, code)}
        assert {bytes(error)[28:] for error in errors} == lost
        assert scene.kernels["bob"].quiet

    with_scene(tmp_path, work, refuse)


def test_a_packet_waits_for_light_by_the_clock_of_the_network(tmp_path: Path) -> None:
    """Half a second of the network, of which each takes three here."""

    def refuse(setup: Setup) -> Setup:
        return replace(setup, verdict=Verdict.REFUSED, reason=Reason.BUSY)

    def work(scene: Scene) -> None:
        began_s = time.monotonic()
        scene.ping()
        assert (scene.kernels["alice"].received())[ICMP].type == 3
        assert time.monotonic() - began_s >= 3 * 0.5

    with_scene(tmp_path, work, refuse, time_scale=3.0)


def test_refused_packets_leave_room_in_the_queue(tmp_path: Path) -> None:
    """Twice what it holds: the second half can be offered when the first has been refused."""

    def refuse(setup: Setup) -> Setup:
        return replace(setup, verdict=Verdict.REFUSED, reason=Reason.BUSY)

    def work(scene: Scene) -> None:
        count = 2 * MOST_QUEUED_BYTES // MTU
        packet = scene.ping(size=MTU - 28)
        for _ in range(count - 1):
            scene.kernels["alice"].sends.put(packet)
        errors = [scene.kernels["alice"].received() for _ in range(count)]
        assert {(error[ICMP].type, error[ICMP].code) for error in errors} == {(3, 1)}

    with_scene(tmp_path, work, refuse)


def test_a_packet_that_its_sender_may_not_send_here_reaches_nobody(tmp_path: Path) -> None:
    forged: list[dict[str, Any]] = [
        {"src": "10.1.0.9"},
        {"src": BOB},
        {"dst": ALICE},
        {"dst": "10.0.0.2"},
    ]

    def work(scene: Scene) -> None:
        bob = scene.interfaces["bob"]
        for header in forged:
            packet = bytes(IP(**{"src": ALICE, "dst": BOB, **header}) / ICMP())
            bob.deliver(decode(packet, MTU), OF_ALICE)
        for ends in (("fd71:6d6e::9", LIGHT6["bob"]), (LIGHT6["alice"], "fd71:6d6e::9")):
            packet = bytes(IPv6(src=ends[0], dst=ends[1]) / ICMPv6EchoRequest())
            bob.deliver(decode(packet, MTU), OF_ALICE)
        assert scene.kernels["bob"].quiet
        bob.deliver(decode(bytes(IP(src=ALICE, dst=BOB) / ICMP()), MTU), OF_ALICE)
        assert scene.kernels["bob"].received().src == ALICE

    with_scene(tmp_path, work)


def test_a_queue_takes_no_more_than_it_may(tmp_path: Path) -> None:
    """A sender that is faster than its light waits: nothing is dropped, and all comes in order."""

    def work(scene: Scene) -> None:
        count = 2 * MOST_QUEUED_BYTES // MTU
        sent = [scene.ping(size=MTU - 28, id=number) for number in range(count)]
        assert [bytes(scene.kernels["bob"].received()) for _packet in sent] == sent

    with_scene(tmp_path, work)


def test_bytes_that_are_no_packets_end_the_session_that_brought_them(tmp_path: Path) -> None:
    def work(scene: Scene) -> None:
        with QuantumSocket(tmp_path / "alice.sock") as light:
            light.settimeout(SOON_S)
            light.connect(("bob", PACKETS_PORT))
            light.sendall(scene.ping()[:20] + b"no packet" * 20)
        scene.wait_until_idle()

    with_scene(tmp_path, work)


def test_packets_of_both_versions_share_the_light(tmp_path: Path) -> None:
    def work(scene: Scene) -> None:
        sixth = bytes(IPv6(src=LIGHT6["alice"], dst=LIGHT6["bob"]) / ICMPv6EchoRequest(data=b"6"))
        scene.kernels["alice"].sends.put(sixth)
        fourth = scene.ping()
        received = [bytes(scene.kernels["bob"].received()) for _ in range(2)]
        assert received == [sixth, fourth]

    with_scene(tmp_path, work)


def test_an_address_of_ipv6_that_nobody_has_is_answered_by_icmpv6(tmp_path: Path) -> None:
    def work(scene: Scene) -> None:
        lost = bytes(IPv6(src=LIGHT6["alice"], dst="fd71:6d6e::77") / ICMPv6EchoRequest(data=b"x"))
        scene.kernels["alice"].sends.put(lost)
        error = IPv6(bytes(scene.kernels["alice"].received()))
        assert (error.src, error.dst) == (ROUTER6, LIGHT6["alice"])
        assert (error[ICMPv6DestUnreach].type, error[ICMPv6DestUnreach].code) == (1, 3)
        many = bytes(IPv6(src=LIGHT6["alice"], dst="ff02::16") / ICMPv6EchoRequest())
        scene.kernels["alice"].sends.put(many)
        scene.ping(dst="10.1.0.77")  # what is answered next is this one
        assert scene.kernels["alice"].received()[ICMP].code == 7

    with_scene(tmp_path, work)
