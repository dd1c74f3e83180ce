"""The optical switch as its controllers see it: bridge, light paths and hardware together."""

import asyncio
import logging
import secrets
import time
from collections.abc import AsyncIterator, Awaitable, Callable, Iterable
from contextlib import asynccontextmanager
from dataclasses import replace
from typing import Protocol

from qswitch_agent.bridge import SupervisoryChannels
from qswitch_agent.hardware.optics import (
    Condition,
    CrossConnect,
    HardwareFault,
    HardwareRefusal,
    OpticalHardware,
    Readings,
)
from qswitch_agent.inner_ports import InnerPorts
from qswitch_agent.light_paths import Asker, LightPaths
from qswitch_agent.middleware import optical_ports
from qswitch_agent.middleware.flow_table import FlowTable
from qswitch_agent.middleware.optical_ports import Tuned
from qswitch_agent.openflow import constants as ofp
from qswitch_agent.openflow import refusals
from qswitch_agent.openflow.flows import FlowEntry, FlowMod
from qswitch_agent.openflow.identity import Identity, on_fiber
from qswitch_agent.openflow.ports import Port
from qswitch_agent.timeouts import CONDITION_DEADLINE_S
from wire.optical import PathOptics, PortLight, PortTuning

log = logging.getLogger(__name__)
MAX_SEEN = 16_384  # sessions
MIN_CIRCUIT, MAX_CIRCUIT = 1, (1 << 31) - 1


class Unconfirmed(Protocol):
    """A controller's connection, whose last changes the bridge may not have made yet."""

    confirmed: int  # how many it has certainly made, or refused

    @property
    def deletions(self) -> list[FlowMod]:
        """Those that the flow monitor may not have reported and that delete."""

    @property
    def only_deletes(self) -> bool:
        """Whether it has certainly reported all others."""

    @property
    def all_reported(self) -> bool:
        """Whether it has certainly reported all changes."""

    def seen_in(self, table: FlowTable) -> bool:
        """Tell whether a table shows all that the bridge has made."""

    async def confirm(self) -> bool:
        """Wait until the bridge has made all; tell whether any may be unreported yet."""

    def reported(self, confirmed: int) -> None:
        """Note the number of changes that the flow monitor has reported."""


class Switch:
    """The state that all connections of all controllers share."""

    def __init__(
        self,
        paths: LightPaths,
        channels: SupervisoryChannels,
        hardware: OpticalHardware,
        synchronise: Callable[[], Awaitable[None]],
        delete: Callable[[FlowEntry], None],
        name: str = "",
        needs_copies: bool = False,
        inner: InnerPorts | None = None,
    ) -> None:
        """`needs_copies`: only for sessions whose set-up has come on copper, too, light passes.

        `synchronise` returns when the table is what the bridge has reported up to now.

        `delete` has the bridge delete an entry.
        """
        self.paths = paths
        self.fibers, self.inner = paths.table.fibers, paths.table.inner
        self.inputs, self.light_ports = paths.table.inputs, paths.table.light
        self.inner_ports = inner or InnerPorts({}, lambda _port, _frame: None)
        self.connections: set[Unconfirmed] = set()
        self._synchronise = synchronise
        self._delete = delete
        self.identity = Identity(name, len(self.fibers))
        paths.promises.break_one = self._take_back
        self._synchronised_ns = 0  # when that was begun last, of those that are done
        self.hardware = hardware
        self._channels = channels
        self.needs_copies = needs_copies
        self._seen: dict[int, None] = {}  # sessions whose set-ups have come, the oldest first
        self.ports: set[int] = set()  # all that the bridge has
        self._condition = Condition()
        self._known = asyncio.Event()
        self._checking = asyncio.Lock()
        self._newest: tuple[int, Readings] = 0, Readings()  # when they were asked for

    def setup_came(self, session: int) -> None:
        self._seen[session] = None
        if len(self._seen) > MAX_SEEN:
            del self._seen[next(iter(self._seen))]

    def require_seen(self, session: int) -> None:
        """Raise Refusal for light of a session, by cookie, whose set-up has not come here."""
        if not self.needs_copies or session in self._seen:
            return
        if all(entry.cookie != session for entry in self.paths.table.marked()):
            raise refusals.not_permitted(f"no set-up of {session:016x} has come on copper")

    async def started(self) -> None:
        try:
            async with asyncio.timeout(CONDITION_DEADLINE_S):
                await self._known.wait()
        except TimeoutError as error:
            raise HardwareFault(
                f"the hardware did not tell its condition in {CONDITION_DEADLINE_S} s"
            ) from error

    async def synchronise(self, since_ns: int | None = None) -> None:
        """Return when the table is what the bridge has reported up to now, or up to then."""
        if since_ns is None or self._synchronised_ns <= since_ns:
            begun_ns = time.monotonic_ns()
            await self._synchronise()
            self._synchronised_ns = max(self._synchronised_ns, begun_ns)

    async def ready(self, connection: Unconfirmed) -> None:
        """Return when light passes as the bridge's table says now, as far as it can.

        Where the flow monitor has reported what was asked for already, the bridge is not asked.
        """
        others = self.connections - {connection}
        seen = all(other.all_reported for other in others) and connection.seen_in(self.paths.table)
        if not seen:
            await self.synchronise()
        await self.paths.ready()

    @asynccontextmanager
    async def trial(self, connection: Unconfirmed) -> AsyncIterator[FlowTable]:
        """Give a copy of the table in which a controller can try a change; one at a time.

        It includes earlier requests of controllers, whether they waited for them or not.
        """
        async with self._checking:
            waited = [
                other
                for other in list(self.connections)
                if other is not connection or not other.only_deletes
            ]
            if any([await other.confirm() for other in waited]):
                confirmed = [other.confirmed for other in waited]
                await self.synchronise()
                for other, changes in zip(waited, confirmed, strict=True):
                    other.reported(changes)
            table = self.paths.table.copy()
            for mod in connection.deletions:
                table.change(mod)
            yield table

    def require_possible(self, trial: FlowTable, mods: Iterable[FlowMod]) -> None:
        """Raise Refusal if a change asks for a path that cannot be, or makes one impossible.

        `mods` are the messages to the bridge for it.
        """
        for reason in self.impossible(trial, mods).values():
            raise refusals.bad_out_port(reason)  # it may be valid at another time

    def impossible(self, trial: FlowTable, mods: Iterable[FlowMod]) -> dict[CrossConnect, str]:
        """Return the paths that a change asks for or affects and that cannot be, and why."""
        refused = trial.plan().refused
        if not refused:
            return {}
        requested = circuits(mods)
        already = self.paths.table.plan().refused
        return {
            path: reason
            for path, reason in refused.items()
            if path not in already or path.circuit in requested
        }

    def promise(self, mod: FlowMod, asker: Asker, request: bytes) -> None:
        path = self.paths.table.path_of(mod)
        if path is not None:
            self.paths.promises.add(path, asker, request)

    def seen_when_done(self, mods: Iterable[FlowMod]) -> tuple[FlowMod, ...] | None:
        """Return the messages to the bridge; None if the table shows one before it is executed."""
        mods = tuple(mods)
        shown = any(self.paths.table.shows(mod) for mod in mods if not mod.deletes)
        return None if shown else mods

    def _take_back(self, path: CrossConnect) -> None:
        """Delete the entry of a path that the hardware has refused."""
        entry = self.paths.table.light_paths().get(path)
        if entry is not None:
            self._delete(entry)

    def new_circuit(self) -> int:
        return secrets.randbelow(MAX_CIRCUIT) + MIN_CIRCUIT

    async def read(self, since_ns: int | None = None) -> Readings:
        """Return what the hardware counts and measures, now or at some time since then.

        Raise HardwareFault if it does not.
        """
        asked_ns, readings = self._newest
        if since_ns is None or asked_ns <= since_ns:
            asked_ns = time.monotonic_ns()
            try:
                readings = await self.hardware.read()
            except HardwareRefusal as refusal:
                raise HardwareFault(f"the hardware refuses to be read: {refusal}") from refusal
            self._newest = asked_ns, readings
        return readings

    def send_lldp(self, port: int, frame: bytes) -> None:
        if port not in self._channels.ports:
            raise refusals.bad_out_port(f"no port {port}")
        self._channels.send(port, frame)

    def require_address(self, number: int, address: bytes) -> None:
        """Raise Refusal unless this is the hardware address of a port, as PORT_MOD must know."""
        port = self._channels.ports.get(number)
        if port is None:
            raise refusals.bad_port(f"there is no port {number}")
        if port.address != address:
            raise refusals.bad_address(
                f"port {number} has the address {port.address.hex(':')}, not {address.hex(':')}",
            )

    def condition_changed(self, condition: Condition) -> None:
        """Take the hardware's condition; controllers hear of the ports that it concerns."""
        before, self._condition = self._condition, condition
        affected = {port for path in before.stuck ^ condition.stuck for port in path}
        if before.hot != condition.hot:
            affected |= self.fibers
        if self._known.is_set():
            log.info("another condition; it concerns ports %s", sorted(affected) or "none")
            self._channels.announce(affected & self.fibers)
            self.inner_ports.announce(before.failed ^ condition.failed)
        self._known.set()
        self.paths.update_stuck(condition.stuck)

    def update_ports(self, ports: Iterable[Port]) -> None:
        for port in ports:
            (self.ports.discard if port.gone else self.ports.add)(port.number)

    @property
    def described(self) -> dict[int, Port]:
        return self._channels.ports

    @property
    def optical_alone(self) -> bool:
        """Whether there is no copper, so that the bridge forwards no packets."""
        return not self.ports - self.light_ports - {ofp.OFPP_LOCAL}

    def shown(self, port: Port) -> Port:
        """Return the description of a port of light as a controller sees it.

        OFPPS_BLOCKED: a cross-connect of the port is stuck. OFPPS_LIVE: light passes as it
        should: the fibre is whole, and the hardware not too hot.
        """
        if port.number in self.inner:
            memory, state = dict(self._condition.memory), port.state
            if (cutoff_s := self._condition.cutoffs_s.get(port.number)) is not None:
                memory["cutoff_s"] = cutoff_s
            properties = self.inner_ports.description(port.number, memory)
            if port.number in self._condition.failed:
                state = (state | ofp.OFPPS_LINK_DOWN) & ~ofp.OFPPS_LIVE
            config = port.config & ~ofp.OFPPC_NO_FWD
            config |= ofp.OFPPC_PORT_DOWN * (port.number in self.paths.down)
            return replace(port, config=config, state=state, properties=properties)
        state = port.state
        if any(port.number in path for path in self._condition.stuck):
            state |= ofp.OFPPS_BLOCKED
        healthy = port.up and not self._condition.hot
        state = state | ofp.OFPPS_LIVE if healthy else state & ~ofp.OFPPS_LIVE
        config = port.config & ~ofp.OFPPC_NO_FWD  # our own, not the controllers'
        optics = optical_ports.description(self._condition, port.number).encode()
        properties = on_fiber(port.properties) + optics
        return Port(port.number, port.address, port.name, config, state, properties)

    def path_optics(self) -> list[PathOptics]:
        """Return what paths do to light: first all that are not named, then the others."""
        return optical_ports.path_optics(self._condition)

    def tuning(self, port: int, tuning: PortTuning) -> Tuned:
        """Return what a PORT_MOD asks for; raise Refusal for what a port cannot be tuned to."""
        return optical_ports.tuned(tuning, optical_ports.tuning_of(self._condition, port))

    async def tune(self, port: int, tuned: Tuned) -> None:
        """Tune a port, or set it up or down; raise HardwareRefusal if it cannot be tuned so."""
        frequency_mhz, power_dbm, direction, cutoff_s, down = tuned
        if tuned._replace(down=None) != Tuned(None, None):
            await self.hardware.tune(port, frequency_mhz, power_dbm, direction, cutoff_s)
        if down is not None and self.paths.set_down(port, down):
            self.inner_ports.announce([port])

    def light(self, port: int, readings: Readings) -> PortLight:
        """Return the optical statistics of a port; no light comes from a fibre that is cut."""
        whole = port in self._channels.ports and self._channels.ports[port].up
        tuning = optical_ports.tuning_of(self._condition, port)
        return optical_ports.light(readings, port, whole, tuning.grid_mhz if tuning else 0)


def circuits(mods: Iterable[FlowMod]) -> set[int]:
    return {mod.instructions.mark.circuit for mod in mods if mod.instructions.mark}
