"""Keeps the hardware's cross-connects what the flow table asks for."""

import asyncio
import logging
import time
from collections.abc import Iterable

from qswitch_agent.hardware.optics import (
    CrossConnect,
    HardwareFault,
    HardwareRefusal,
    OpticalHardware,
)
from qswitch_agent.middleware import FlowTable
from qswitch_agent.openflow import FlowUpdate, PortState

log = logging.getLogger(__name__)


class NotReady(Exception):
    """The hardware does not do what the flow table asks for; the message says why."""


class LightPaths:
    """The flow table on one side, the hardware on the other, and how far they agree."""

    def __init__(self, fiber_ports: Iterable[int], hardware: OpticalHardware) -> None:
        self._table = FlowTable(fiber_ports)
        self._hardware = hardware
        self._made: frozenset[CrossConnect] | None = None  # None: unknown
        self._asked = 0  # counts the changes of the table
        self._answered = -1  # up to which of them the hardware has answered
        self._problem = ""  # why the hardware differs from the table, as of the last answer
        self._fault: HardwareFault | None = None  # what ended run
        self._changed = asyncio.Event()
        self._progress = asyncio.Condition()

    def update(self, updates: Iterable[FlowUpdate]) -> None:
        """Take changes of the flow table; the hardware follows as soon as it can."""
        for update in updates:
            if self._table.is_foreign(update):
                log.warning("not a path between two fibres, ignored: %s", update.entry)
            self._table.apply(update)
        self._asked += 1
        self._changed.set()

    def update_ports(self, states: Iterable[PortState]) -> None:
        """Take the state of ports: no light passes a fibre that is cut."""
        for state in states:
            if self._table.set_fiber(state.number, state.up):
                condition = "whole again" if state.up else "cut"
                log.info("the fibre at port %d is %s", state.number, condition)
                self._asked += 1
                self._changed.set()

    async def run(self) -> None:
        """Bring the hardware up to date, at the start and after each change; never returns."""
        self._changed.set()
        while True:
            await self._changed.wait()
            self._changed.clear()
            asked = self._asked
            try:
                problem = await self._bring_up_to_date()
            except HardwareFault as fault:
                self._fault = fault
                await self._answer(asked, str(fault))
                raise
            if problem and problem != self._problem:
                log.error("%s", problem)
            await self._answer(asked, problem)

    async def ready(self) -> None:
        """Return when the hardware is as the flow table is now.

        Raise NotReady if the hardware cannot do this, HardwareFault if it has failed.
        """
        asked = self._asked
        async with self._progress:
            await self._progress.wait_for(lambda: self._answered >= asked)
        if self._fault:
            raise HardwareFault(str(self._fault))
        if self._problem:
            raise NotReady(self._problem)

    async def _answer(self, asked: int, problem: str) -> None:
        self._answered, self._problem = asked, problem
        async with self._progress:
            self._progress.notify_all()

    async def _bring_up_to_date(self) -> str:
        """Return what of the table the hardware cannot do, empty if it does it all."""
        plan = self._table.plan()
        if plan.cross_connects != self._made:
            started = time.monotonic()
            try:
                await self._hardware.set_cross_connects(plan.cross_connects)
            except HardwareRefusal as refusal:
                return f"the hardware refuses {_text(plan.cross_connects)}: {refusal}"
            self._made = plan.cross_connects
            elapsed_ms = (time.monotonic() - started) * 1e3
            log.info("%s, ready in %.2f ms", _text(plan.cross_connects), elapsed_ms)
        return "; ".join(plan.conflicts)


def _text(cross_connects: frozenset[CrossConnect]) -> str:
    pairs = ", ".join(f"{path.in_port}->{path.out_port}" for path in sorted(cross_connects))
    return f"cross-connects {pairs or 'none'}"
