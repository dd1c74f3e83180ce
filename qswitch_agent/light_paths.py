"""Keeps the hardware's cross-connects what the flow table asks for.

Light entries that were let into the table, until the hardware has done them.

Cross-connects that the hardware is known to be unable to make are refused at FLOW_MOD or COMMIT. If
it turns out later, the controller that asked hears of it by an error with the xid of its message,
before its barrier is answered, and the entry is deleted.
"""

import asyncio
import logging
import time
from collections import OrderedDict
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Protocol

from programs.network_timers import background_sleep
from qswitch_agent.hardware.optics import (
    CrossConnect,
    HardwareFault,
    HardwareRefusal,
    OpticalHardware,
)
from qswitch_agent.middleware.flow_table import FlowTable, circuit_of
from qswitch_agent.openflow.flow_reports import ADDED, REMOVED, FlowUpdate
from qswitch_agent.openflow.flows import FlowEntry
from qswitch_agent.openflow.instructions import Mark
from qswitch_agent.openflow.ports import Port
from qswitch_agent.timeouts import IDLE_POLL_S
from wire.network_time import REAL_TIME, NetworkTime

MAX_PROMISES = 4096  # an entry that the bridge itself has refused stays until then


class Asker(Protocol):
    def fail(self, request: bytes, reason: str) -> None:
        """Answer a request of the controller with an error after all."""


Promise = tuple[Asker, bytes]  # who asked, and the message


class Promises:
    """All of one switch, by the cross-connect that each asks for."""

    def __init__(self) -> None:
        self._open: OrderedDict[CrossConnect, Promise] = OrderedDict()
        self.break_one: Callable[[CrossConnect], None] = lambda _path: None

    def __len__(self) -> int:
        return len(self._open)

    def add(self, path: CrossConnect, asker: Asker, request: bytes) -> None:
        self._open[path] = asker, request
        self._open.move_to_end(path)
        if len(self._open) > MAX_PROMISES:
            self._open.popitem(last=False)

    def due(self, paths: Iterable[CrossConnect]) -> list[CrossConnect]:
        return [path for path in paths if path in self._open]

    def settle(self, due: Iterable[CrossConnect], refused: Mapping[CrossConnect, str]) -> None:
        """The hardware has done what was due, but for what it has refused: answer that."""
        for path in due:
            promise = self._open.pop(path, None)
            if promise is not None and path in refused:
                self._break(path, *promise, refused[path])

    def give_up(self, asker: Asker, reason: str) -> None:
        """Answer all that a controller waits for: it cannot wait any longer."""
        for path, (other, request) in list(self._open.items()):
            if other is asker:
                del self._open[path]
                self._break(path, asker, request, reason)

    def _break(self, path: CrossConnect, asker: Asker, request: bytes, reason: str) -> None:
        asker.fail(request, reason)
        self.break_one(path)


MAX_REMOVED = 4096
log = logging.getLogger(__name__)


@dataclass
class Removed:
    mark: Mark
    idle: bool = False  # the agent has removed it, because no photon passed


class LightPaths:
    """The flow table on one side, the hardware on the other, and how far they agree."""

    def __init__(
        self,
        fiber_ports: Iterable[int],
        hardware: OpticalHardware,
        network_time: NetworkTime = REAL_TIME,
        inner_ports: Iterable[int] = (),
    ) -> None:
        self.time = network_time
        self.table = FlowTable(fiber_ports, inner_ports)
        self.promises = Promises()
        self.down: set[int] = set()  # ports inside the switch, by controllers
        self._hardware = hardware
        self._made: frozenset[CrossConnect] | None = None  # as planned; None: not all of it
        self.standing: frozenset[CrossConnect] = frozenset()  # that the hardware took last
        self._asked = 0  # counts the changes of the table
        self._answered = -1  # up to which of them the hardware has answered
        self._refused: Mapping[CrossConnect, str] = {}  # as of the last answer, and why
        self._fault: HardwareFault | None = None  # what ended run
        self._news = ""  # what was made, and is not in the log yet
        self._changed = asyncio.Event()
        self._progress = asyncio.Event()  # of this answer; the next has another
        self._removed: OrderedDict[tuple[int, bytes, int], Removed] = OrderedDict()
        self._added_ns: dict[int, int] = {}  # when entries came, by circuit
        self._idle: set[tuple[int, bytes, int]] = set()  # asked to be removed
        self._ended: set[int] = set()  # circuits of entries removed since the hardware was asked

    def update(self, updates: Iterable[FlowUpdate]) -> None:
        """Take changes of the flow table; the hardware follows as soon as it can."""
        for update in updates:
            if self.table.is_foreign(update):
                log.warning("not a path between two fibres, ignored: %s", update.entry)
            if update.event == REMOVED and update.entry is not None:
                self._remember(update.entry)
            elif update.event == ADDED and update.entry is not None and update.entry.mark:
                self._added_ns[update.entry.mark.circuit] = self._now_ns()
            self.table.apply(update)
        self._ask()

    def update_ports(self, ports: Iterable[Port]) -> None:
        """Take the state of ports: no light passes a fibre that is cut."""
        for port in ports:
            if self.table.set_fiber(port.number, port.up and port.number not in self.down):
                condition = "whole again" if port.up else "cut"
                log.info("the fibre at port %d is %s", port.number, condition)
                self._ask()

    def set_down(self, port: int, down: bool) -> bool:
        """Set a port inside the switch down, or up; tell whether that is news."""
        if down == (port in self.down):
            return False
        self.down ^= {port}
        self.table.set_fiber(port, not down)
        self._ask()
        return True

    def update_stuck(self, stuck: frozenset[tuple[int, int]]) -> None:
        """Take which cross-connects cannot be changed, and ask again for what was refused."""
        changed = stuck != self.table.stuck
        self.table.stuck = stuck
        if changed or self._refused:
            self._ask()

    def _ask(self) -> None:
        self._asked += 1
        self._changed.set()

    def _remember(self, entry: FlowEntry) -> None:
        before = self.table.find(*entry.key)
        if before is None:
            return
        self._ended.add(circuit_of(before))
        if before.mark is None:
            return
        name = (*before.key, before.cookie)
        self._added_ns.pop(before.mark.circuit, None)
        self._removed[name] = Removed(before.mark, name in self._idle)
        self._removed.move_to_end(name)
        self._idle.discard(name)
        if len(self._removed) > MAX_REMOVED:
            self._removed.popitem(last=False)

    def removed(self, priority: int, match: bytes, cookie: int) -> Removed | None:
        """Return what is known of a light entry that was removed a short while ago."""
        return self._removed.get((priority, match, cookie))

    async def run(self) -> None:
        """Bring the hardware up to date, at the start and after each change; never returns."""
        self._changed.set()
        while True:
            await self._changed.wait()
            self._changed.clear()
            request = self._asked
            due = self.promises.due(self.table.light_paths()) if self.promises else []
            try:
                refused = await self._bring_up_to_date()
            except HardwareFault as fault:
                self._fault = fault
                self.promises.settle(due, dict.fromkeys(due, str(fault)))
                self._answer(request, self._refused)
                raise
            for path, reason in refused.items():
                if self._refused.get(path) != reason:
                    log.error("%s", reason)
            self.promises.settle(due, refused)
            self._answer(request, refused)
            await self._tell()

    async def ready(self) -> None:
        """Return when the hardware is as the flow table is now, as far as it can be.

        Raise HardwareFault if the hardware has failed.
        """
        request = self._asked
        while self._answered < request:
            await self._progress.wait()
        if self._fault:
            raise HardwareFault(str(self._fault))

    async def expire(self, delete: Callable[[FlowEntry], None]) -> None:
        """Delete entries through which no photon has passed for their idle time-out, for ever."""
        active: dict[int, int] = {}  # when a photon passed, or an entry was first seen, by circuit
        while True:
            await background_sleep(self.time, IDLE_POLL_S)
            waiting = [(e, e.mark) for e in self.table.marked() if e.mark and e.mark.idle_timeout_s]
            if not waiting:
                active.clear()
                continue
            try:
                readings = await self._hardware.read()
            except HardwareRefusal as refusal:
                log.error("no idle path can be found: %s", refusal)
                continue
            if not readings.counts_photons:
                log.warning("this hardware counts no photons: idle time-outs have no effect")
                return
            now_ns = self._now_ns()
            circuits = readings.circuits
            active = {mark.circuit: active.get(mark.circuit, now_ns) for _, mark in waiting}
            active |= {name: circuits[name].last_ns for name in active if name in circuits}
            for entry, mark in waiting:
                name = (*entry.key, entry.cookie)
                last_ns = max(active[mark.circuit], self._added_ns.get(mark.circuit, 0))
                if now_ns - last_ns >= mark.idle_timeout_s * 1_000_000_000:
                    if name not in self._idle:
                        log.info("no photon for %d s: %s", mark.idle_timeout_s, entry)
                    self._idle.add(name)
                    delete(entry)

    def _now_ns(self) -> int:
        return self.time.now_ns()

    def _answer(self, request: int, refused: Mapping[CrossConnect, str]) -> None:
        self._answered, self._refused = request, refused
        self._progress.set()
        self._progress = asyncio.Event()

    async def _tell(self) -> None:
        """Log what was made; those that waited for it go on first."""
        if self._news:
            news, self._news = self._news, ""
            await asyncio.sleep(0)
            log.info("%s", news)

    async def _bring_up_to_date(self) -> Mapping[CrossConnect, str]:
        """Do what can be had of the table; return what cannot, and why."""
        plan = self.table.plan()
        ended, self._ended = self._ended, set()
        closed = frozenset(path for path in self.standing if path.circuit in ended)
        opened_again = {path[:2] for path in closed} & {path[:2] for path in plan.cross_connects}
        if plan.cross_connects == self._made and not opened_again:
            return plan.refused
        started = time.monotonic()
        if opened_again:  # it is dark in between, however soon one follows the other
            await self._make(self.standing - closed)
        refused = await self._make(plan.cross_connects)
        opened = plan.cross_connects - refused.keys()
        self._made = None if refused else opened
        elapsed_ms = (time.monotonic() - started) * 1e3
        self._news = f"{_text(opened)}, ready in {elapsed_ms:.2f} ms"
        return {**plan.refused, **refused}

    async def _make(self, paths: frozenset[CrossConnect]) -> dict[CrossConnect, str]:
        """Make cross-connects; if the hardware refuses them together, each that it can.

        A refusal changes nothing, so what stands already and is wanted stays as it is.
        """
        if not (reason := await self._refusal(paths)):
            return {}
        log.warning("the hardware refuses %s: %s; each is tried alone", _text(paths), reason)
        before = {path[:2] for path in self.standing}
        standing = frozenset(path for path in paths if path[:2] in before)
        if await self._refusal(standing):  # what stood cannot stand any more
            standing = frozenset()
        refused = {}
        for path in sorted(paths - standing):
            reason = await self._refusal(standing | {path})
            if reason:
                refused[path] = f"the hardware refuses {path.in_port}->{path.out_port}: {reason}"
            else:
                standing |= {path}
        return refused

    async def _refusal(self, paths: frozenset[CrossConnect]) -> str:
        """Try to make exactly these cross-connects; return why not, empty if they are made."""
        try:
            await self._hardware.set_cross_connects(paths)
        except HardwareRefusal as refusal:
            return str(refusal) or "it does not say why"
        self.standing = paths
        return ""


def _text(cross_connects: frozenset[CrossConnect]) -> str:
    pairs = ", ".join(f"{path.in_port}->{path.out_port}" for path in sorted(cross_connects))
    return f"cross-connects {pairs or 'none'}"
