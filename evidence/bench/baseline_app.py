"""A controller app that times one switch: what the framework and Open vSwitch take by themselves.

learning    packet-in, entry, packet-out, until the switch has done it (a barrier)
bundle      three paths in one bundle, and a barrier
full        every port's path replaced by another, in one bundle, and a barrier

Turns come at a given rate: what rests between two of them finds its processor cold.
"""

import time
from collections.abc import Iterator
from typing import Any

from controller_apps.openflow import flow_entries
from controller_apps.openflow.flow_entries import LIGHT_TABLE, PATH_PRIORITY
from controller_apps.openflow.framework import (
    MAIN,
    App,
    EndOnFault,
    hub,
    ofp_event,
    ofproto,
    on,
    parser,
)
from qmn.timeouts import TURN_TIMEOUT_S

SESSION, MISS = 1, 2  # cookies: of the entries that come and go, and of the one that stays
FRAME = bytes.fromhex("020000000001 020000000002 88b5") + bytes(46)  # local experimental EtherType
PORT = 1
BUNDLE_HOPS = ((4, 1), (1, 3), (5, 2))  # as for superdense coding
FLAGS = ofproto.OFPBF_ATOMIC | ofproto.OFPBF_ORDERED
SHIFTS = (1, 3)  # of the ports, in turns


class Baseline(App):
    OFP_VERSIONS = (ofproto.OFP_VERSION,)

    def __init__(self, what: str, count: int, ports: int, period_s: float, **contexts: Any) -> None:
        super().__init__(**contexts)
        self._turns = {"learning": self._learning, "bundle": self._bundle, "full": self._full}[what]
        self._count = count
        self._ports = ports
        self._period_s = period_s
        self._numbers = iter(range(1, 1 << 31))
        self._datapath: Any = None
        self._awaited = 0  # xid
        self._started = 0.0
        self._passed = hub.Queue()
        self.times_ms = hub.Queue()  # gets one list

    @on(ofp_event.EventOFPStateChange, MAIN)
    def switch_here(self, event: Any) -> None:
        if self._datapath is None:
            self._datapath = event.datapath
            hub.spawn(self._measure)

    @on(ofp_event.EventOFPPacketIn, MAIN)
    def packet_arrived(self, event: Any) -> None:
        """Do what a learning switch does for a station that it knows."""
        arrived = time.perf_counter()
        frame = bytes(event.msg.data)
        if frame != FRAME:
            return
        self._started = arrived
        match = {"in_port": PORT, "eth_src": station(frame[6:12]), "eth_dst": station(frame[:6])}
        entry = flow_entries.add(
            self._datapath, 0, 1, match, flow_entries.output(PORT + 1), cookie=SESSION
        )
        out = flow_entries.packet_out(self._datapath, PORT, PORT + 1, frame)
        self._send(entry, out)

    @on(ofp_event.EventOFPBarrierReply, MAIN)
    def barrier_passed(self, event: Any) -> None:
        passed = time.perf_counter()
        if event.msg.xid == self._awaited:
            self._passed.put(passed)

    @on(ofp_event.EventOFPErrorMsg, MAIN)
    def refused(self, event: Any) -> None:
        """A measurement of refusals would be none."""
        raise RuntimeError(f"the switch refuses: type {event.msg.type}, code {event.msg.code}")

    def _measure(self) -> None:
        with EndOnFault(self.name):
            times_ms, due = [], time.monotonic()
            for turn_ms in self._turns():
                times_ms.append(turn_ms)
                due += self._period_s
                hub.sleep(max(0.0, due - time.monotonic()))
            self.times_ms.put(times_ms)

    def _learning(self) -> Iterator[float]:
        miss = flow_entries.add(self._datapath, 0, 0, {}, flow_entries.to_controller(), cookie=MISS)
        self._datapath.send_msg(miss)
        through_table = parser.OFPPacketOut(
            self._datapath,
            buffer_id=ofproto.OFP_NO_BUFFER,
            in_port=PORT,
            actions=[parser.OFPActionOutput(ofproto.OFPP_TABLE)],
            data=FRAME,
        )
        for _ in range(self._count):
            self._datapath.send_msg(through_table)
            turn_ms = self._turn_ms()
            self._clear()
            yield turn_ms

    def _bundle(self) -> Iterator[float]:
        for _ in range(self._count):
            self._started = time.perf_counter()
            self._program(BUNDLE_HOPS)
            turn_ms = self._turn_ms()
            self._clear()
            yield turn_ms

    def _full(self) -> Iterator[float]:
        self._clear()
        for number in range(-1, self._count):  # the first makes the paths, it replaces none
            shift = SHIFTS[number % len(SHIFTS)]
            self._started = time.perf_counter()
            self._program(
                tuple((port + 1, (port + shift) % self._ports + 1) for port in range(self._ports))
            )
            turn_ms = self._turn_ms()
            if number >= 0:
                yield turn_ms

    def _program(self, hops: tuple[tuple[int, int], ...]) -> None:
        bundle, datapath = next(self._numbers), self._datapath
        begin, end = (
            parser.OFPBundleCtrlMsg(datapath, bundle, kind, FLAGS, [])
            for kind in (ofproto.OFPBCT_OPEN_REQUEST, ofproto.OFPBCT_COMMIT_REQUEST)
        )
        members = []
        for in_port, out_port in hops:
            match, way = {"in_port": in_port}, flow_entries.output(out_port)
            entry = flow_entries.add(
                datapath, LIGHT_TABLE, PATH_PRIORITY, match, way, cookie=SESSION
            )
            members.append(parser.OFPBundleAddMsg(datapath, bundle, FLAGS, entry, []))
        self._send(begin, *members, end)

    def _clear(self) -> None:
        """Delete the entries of a turn, and wait until they are gone.

        At its end: a turn begins after a pause, as a session does, with nothing warmed up.
        """
        self._send(flow_entries.delete_paths(self._datapath, SESSION))
        self._turn_ms()

    def _send(self, *messages: Any) -> None:
        barrier = parser.OFPBarrierRequest(self._datapath)
        self._datapath.set_xid(barrier)
        self._awaited = barrier.xid
        flow_entries.send(self._datapath, [*messages, barrier])

    def _turn_ms(self) -> float:
        """Wait for the barrier; return the time since the turn began, in ms."""
        passed: float = self._passed.get(timeout=TURN_TIMEOUT_S)
        return (passed - self._started) * 1e3


def station(address: bytes) -> str:
    return address.hex(":")
