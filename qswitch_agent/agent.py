"""One quantum switch's agent: its three layers put together, from start to end."""

import asyncio
from collections.abc import Callable, Coroutine
from contextlib import AbstractAsyncContextManager, nullcontext
from functools import partial
from typing import Any

from qswitch_agent.bridge import Commands, Monitor, SupervisoryChannels
from qswitch_agent.hardware.optics import OpticalHardware
from qswitch_agent.inner_ports import InnerPorts
from qswitch_agent.light_paths import LightPaths
from qswitch_agent.openflow.ports import Port
from qswitch_agent.proxy.proxy import Address, Programs, Proxy, Server
from qswitch_agent.switch import Switch
from wire.config import AgentConfig, BadConfig
from wire.parameters.switch import inner_ports
from wire.registered import TELEMETRY, load, only


class Agent:
    def __init__(self, config: AgentConfig, hardware: OpticalHardware) -> None:
        self._hardware, self._config = hardware, config
        inner = inner_ports(config.analysers, config.memories, config.sources, config.emitters)
        self._paths = LightPaths(config.fiber_ports, hardware, config.time, inner)
        self._monitor = Monitor(config.management, self._paths.update, self._ports_changed)
        self._commands = Commands(config.management)
        send, announce = self._commands.send_from, self._commands.announce
        self._inner = InnerPorts(inner, send, config.parts, announce)
        self._channels = SupervisoryChannels(self._paths.table.fibers, self._commands)
        self._switch = Switch(
            self._paths,
            self._channels,
            hardware,
            self._monitor.synchronise,
            self._commands.delete,
            config.switch,
            config.needs_copies,
            self._inner,
        )
        tls = config.credentials.client() if config.credentials is not None else None
        self._servers: list[tuple[Server, str]] = [
            (Proxy(address(controller), self._switch, tls), config.listening(number))
            for number, controller in enumerate(config.controllers)
        ]
        if config.programs:
            programs = Programs(config.management, self._switch)
            self._servers.append((programs, config.programs))
        for server, _listen in self._servers:
            server.batches = not config.time_folder  # time would leap meanwhile

    async def run(self, stop: asyncio.Event) -> None:
        """Serve until stop is set, and say `ready` on stdout when the light paths stand.

        Controller i of the configuration is served where AgentConfig.listening says. Raise an
        exception group with a BridgeFault, HardwareFault or BadConfig, or BadPackage, if the
        agent cannot go on; held replies are answered before.
        """
        telemetry = self._telemetry()
        await self._monitor.open()
        await self._commands.open()
        layers = [
            self._monitor.run(),
            self._commands.run(),
            self._hardware.watch(self._switch.condition_changed),
            self._synchronised(self._paths.run),
            self._paths.expire(self._commands.delete),
            self._start(),
        ]
        if self._paths.table.inner:
            watch = partial(self._hardware.watch_analysers, self._inner.report)
            layers.append(self._synchronised(watch))
        try:
            async with telemetry, asyncio.TaskGroup() as group:
                tasks = [group.create_task(layer) for layer in layers]
                await stop.wait()
                for task in tasks:
                    task.cancel()
        finally:
            for server, _listen in self._servers:
                await server.close()
            self._monitor.close()
            self._commands.close()
            self._channels.close()

    def _telemetry(self) -> AbstractAsyncContextManager[None]:
        if not self._config.gnmi:
            return nullcontext()
        serving = load(only("--gnmi", TELEMETRY))
        server: AbstractAsyncContextManager[None] = serving(self._config, self._switch)
        return server

    async def _synchronised(self, layer: Callable[[], Coroutine[Any, Any, None]]) -> None:
        """Run a layer that knows entries and ports: what stands in the bridge goes on."""
        await self._monitor.synchronise()
        await layer()

    async def _start(self) -> None:
        """Make the cross-connects of the table as it is, then let the bridge connect."""
        await self._switch.started()
        await self._monitor.synchronise()
        await self._commands.barrier()  # no packet goes into a fibre from here on
        await self._paths.ready()
        for server, listen in self._servers:
            try:
                await server.serve(listen if listen.startswith("/") else address(listen))
            except OSError as error:
                raise BadConfig(
                    f"cannot listen on {listen}: {error.strerror}; "
                    "end the program that has this port, or name another one"
                ) from error
        print("ready", flush=True)

    def _ports_changed(self, ports: list[Port]) -> None:
        self._paths.update_ports(ports)
        self._switch.update_ports(ports)
        self._inner.update(ports)
        self._channels.update(ports)


def address(text: str) -> Address:
    """Return host and port of a text such as 127.0.0.1:6653; raise BadConfig if it is not one."""
    host, _colon, port = text.rpartition(":")
    if not host or not port.isdecimal():
        raise BadConfig(f"{text!r} is not an address; write it as 127.0.0.1:6653")
    return host, int(port)
