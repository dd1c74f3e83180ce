"""The agent's proxy between a bridge and a controller that are plain loopback sockets.

The optical switch is one in memory; the flow monitor says what the test has put into it.
"""

import asyncio
from asyncio import StreamReader, StreamWriter
from collections.abc import AsyncIterator, Callable, Coroutine, Iterable
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from unittest.mock import patch

from limits import SOON_S
from openflow_messages import FIBERS, port

from programs.network_timers import close_timers
from qswitch_agent.bridge import NO_PACKETS, Commands, SupervisoryChannels
from qswitch_agent.hardware import optics
from qswitch_agent.hardware.optics import (
    Condition,
    CrossConnect,
    Direction,
    HardwareRefusal,
    Readings,
    Tuning,
)
from qswitch_agent.light_paths import LightPaths
from qswitch_agent.openflow.flow_reports import FlowUpdate
from qswitch_agent.openflow.messages import Framer
from qswitch_agent.proxy import proxy as proxy_module
from qswitch_agent.proxy.proxy import Proxy
from qswitch_agent.switch import Switch
from topologies.system.runs.runtime import free_port
from wire.analyser_frames import AnalyserFrame, Emission
from wire.network_time import REAL_TIME, NetworkTime

TUNING = Tuning(191_350_000, 196_100_000, 50_000, -20.0, 0.0)
CONDITION = Condition(TUNING, optics.Path(0.5, 1))


def play(scene: Coroutine[Any, Any, None], deadline_s: float = SOON_S) -> None:
    """Run a scene, which must end in time."""
    asyncio.run(asyncio.wait_for(scene, deadline_s))


class Optics:
    """Optical hardware in memory; each change takes until `free` is set."""

    def __init__(self) -> None:
        self.calls: list[set[CrossConnect]] = []
        self.made: set[CrossConnect] = set()
        self.cutoffs_s: dict[int, float] = {}
        self.emitted: list[tuple[int, Emission]] = []
        self.chosen: list[AnalyserFrame] = []
        self.tuned: list[tuple[int, int | None, float | None, Direction]] = []
        self.failure: Exception | None = None
        self.refused: set[tuple[int, int]] = set()  # paths; a set with one of them is refused
        self.readings = Readings()
        self.free = asyncio.Event()
        self.free.set()

    @property
    def paths(self) -> set[tuple[int, int]]:
        """The cross-connects that there are, by ports."""
        return {(one.in_port, one.out_port) for one in self.made}

    async def set_cross_connects(self, cross_connects: Iterable[CrossConnect]) -> None:
        wanted = set(cross_connects)
        self.calls.append(wanted)
        await self.free.wait()
        if self.failure:
            raise self.failure
        if self.refused.intersection((one.in_port, one.out_port) for one in wanted):
            raise HardwareRefusal("the mirror is stuck")
        self.made = wanted

    async def tune(
        self,
        port: int,
        frequency_mhz: int | None,
        power_dbm: float | None,
        direction: Direction = Direction.BOTH,
        cutoff_s: float | None = None,
    ) -> None:
        if self.failure:
            raise self.failure
        self.tuned.append((port, frequency_mhz, power_dbm, direction))
        if cutoff_s is not None:
            self.cutoffs_s[port] = cutoff_s

    async def read(self) -> Readings:
        if self.failure:
            raise self.failure
        return self.readings

    async def watch(self, on_condition: Callable[[Condition], None]) -> None:
        on_condition(CONDITION)
        await asyncio.Event().wait()

    async def watch_analysers(self, _on_report: Callable[[AnalyserFrame], None]) -> None:
        """Report nothing: it has none."""
        await asyncio.Event().wait()

    async def emit(self, port: int, emission: Emission) -> None:
        self.emitted.append((port, emission))

    async def keep(self, chosen: AnalyserFrame) -> None:
        self.chosen.append(chosen)

    async def close(self) -> None:
        """Close nothing."""


class Reports:
    """The flow monitor as the switch sees it: what is put into it comes out when it may."""

    def __init__(self, paths: LightPaths) -> None:
        self._paths = paths
        self.waiting: list[FlowUpdate] = []
        self.asked = 0
        self.open = asyncio.Event()
        self.open.set()

    async def synchronise(self) -> None:
        self.asked += 1
        await self.open.wait()
        updates, self.waiting = self.waiting, []
        if updates:
            self._paths.update(updates)


class End:
    """One end of a connection."""

    def __init__(self, reader: StreamReader, writer: StreamWriter) -> None:
        self.reader, self.writer = reader, writer
        self._framer, self._received = Framer(), list[bytes]()

    def says(self, *messages: bytes) -> None:
        self.writer.write(b"".join(messages))

    async def next(self) -> bytes:
        """Return the next message."""
        while not self._received:
            data = await self.reader.read(1 << 16)
            assert data, "the agent closed the connection"
            self._received = self._framer.feed(data)
        return self._received.pop(0)

    async def hears(self, *expected: bytes) -> None:
        for message in expected:
            assert await self.next() == message

    async def hears_nothing(self) -> None:
        """Check that nothing comes in a twentieth of a second."""
        assert not self._received
        early = asyncio.create_task(self.reader.read(1))
        await asyncio.wait({early}, timeout=0.05)
        assert not early.done(), early.result()
        early.cancel()
        await asyncio.wait({early})

    async def hears_the_end(self) -> None:
        assert await self.reader.read() == b""


class Listener:
    """A controller: each connection to it comes out of `connections`."""

    def __init__(self) -> None:
        self.connections: asyncio.Queue[End] = asyncio.Queue()

    async def start(self, port: int = 0) -> int:
        self.server = await asyncio.start_server(self._accept, "127.0.0.1", port)
        return int(self.server.sockets[0].getsockname()[1])

    def _accept(self, reader: StreamReader, writer: StreamWriter) -> None:
        self.connections.put_nowait(End(reader, writer))


@dataclass
class Stage:
    """A proxy with its bridge's and its controller's end."""

    proxy: Proxy
    port: int
    switch: Switch
    optics: Optics
    reports: Reports
    controllers: Listener
    bridge: End
    controller: End
    commanded: End  # the bridge's end of the connection on which the agent commands it

    async def connect(self) -> tuple[End, End]:
        """Return the ends of one more connection: the bridge's and the controller's."""
        bridge = End(*await asyncio.open_connection("127.0.0.1", self.port))
        return bridge, await self.controllers.connections.get()


@asynccontextmanager
async def running_switch(
    network_time: NetworkTime = REAL_TIME,
) -> AsyncIterator[tuple[Switch, Optics, Reports, End]]:
    """A switch of four fibre ports whose hardware has reported its condition."""
    hardware = Optics()
    async with AsyncExitStack() as stack:
        folder = stack.enter_context(TemporaryDirectory())
        connected: asyncio.Queue[End] = asyncio.Queue()
        path = str(Path(folder) / "q.mgmt")
        management = await asyncio.start_unix_server(
            lambda *ends: connected.put_nowait(End(*ends)), path
        )
        stack.callback(management.close)
        commands = Commands(path)
        await commands.open()
        stack.callback(commands.close)
        commanded = await connected.get()
        stack.callback(commanded.writer.close)
        await commanded.next()
        channels = SupervisoryChannels(FIBERS, commands)
        fibers = [port(number, config=NO_PACKETS) for number in sorted(FIBERS)]
        channels.update(fibers)
        stack.callback(channels.close)
        paths = LightPaths(FIBERS, hardware, network_time)
        stack.callback(close_timers, asyncio.get_running_loop())
        reports = Reports(paths)
        switch = Switch(paths, channels, hardware, reports.synchronise, commands.delete)
        switch.update_ports([*fibers, port(9)])
        running = [
            asyncio.create_task(layer)
            for layer in (paths.run(), hardware.watch(switch.condition_changed))
        ]
        for task in running:
            stack.callback(task.cancel)
        await switch.started()
        yield switch, hardware, reports, commanded


@asynccontextmanager
async def stage(
    hold_deadline_s: float = SOON_S, network_time: NetworkTime = REAL_TIME
) -> AsyncIterator[Stage]:
    """A proxy whose bridge and controller are connected."""
    async with running_switch(network_time) as (switch, hardware, reports, commanded):
        controllers = Listener()
        proxy = Proxy(("127.0.0.1", await controllers.start()), switch, None, hold_deadline_s)
        number = free_port()
        await proxy.serve(("127.0.0.1", number))
        bridge = End(*await asyncio.open_connection("127.0.0.1", number))
        controller = await controllers.connections.get()
        try:
            yield Stage(
                proxy,
                number,
                switch,
                hardware,
                reports,
                controllers,
                bridge,
                controller,
                commanded,
            )
        finally:
            # The player of the bridge is gone by now: it answers no barrier any more.
            with patch.object(proxy_module, "CLOSE_DEADLINE_S", 0.0):
                await proxy.close()
            for end in (bridge, controller):
                end.writer.close()
            controllers.server.close()
