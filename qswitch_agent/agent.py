"""One quantum switch's agent: its three layers put together, from start to end."""

import asyncio
import contextlib

from qswitch_agent.hardware.optics import HardwareFault, OpticalHardware
from qswitch_agent.light_paths import LightPaths, NotReady
from qswitch_agent.management import BridgeFault, Management
from qswitch_agent.proxy import Address, Proxy
from wire.config import AgentConfig, BadConfig


class Agent:
    """The agent of one switch, over the hardware that it is given."""

    def __init__(self, config: AgentConfig, hardware: OpticalHardware) -> None:
        self._hardware = hardware
        self._paths = LightPaths(config.fiber_ports, hardware)
        self._bridge = Management(config.management, self._paths.update, self._paths.update_ports)
        host, port = address(config.listen)
        self._proxies = [
            (Proxy(address(controller), self._paths_ready), (host, port + number))
            for number, controller in enumerate(config.controllers)
        ]

    async def run(self, stop: asyncio.Event) -> None:
        """Serve until stop is set, and say `ready` on stdout when the light paths stand.

        Controller i of the configuration is served on the listening port + i. Raise an
        exception group with a BridgeFault, HardwareFault or BadConfig if the agent cannot
        go on; held replies are answered before.
        """
        await self._bridge.open()
        layers = [self._bridge.run(), self._paths.run(), self._hardware.watch(), self._start()]
        try:
            async with asyncio.TaskGroup() as group:
                tasks = [group.create_task(layer) for layer in layers]
                await stop.wait()
                for task in tasks:
                    task.cancel()
        finally:
            for proxy, _listen in self._proxies:
                await proxy.close()
            self._bridge.close()

    async def _start(self) -> None:
        """Make the cross-connects of the table as it is, then let the bridge connect."""
        await self._bridge.synchronise()
        with contextlib.suppress(NotReady):  # logged, and the controller may change the table
            await self._paths.ready()
        for proxy, listen in self._proxies:
            try:
                await proxy.serve(listen)
            except OSError as error:
                raise BadConfig(
                    f"cannot listen on {listen[0]}:{listen[1]}: {error.strerror}; "
                    "end the program that has this port, or name another one"
                ) from error
        print("ready", flush=True)

    async def _paths_ready(self) -> None:
        try:
            await self._bridge.synchronise()
            await self._paths.ready()
        except (BridgeFault, HardwareFault) as fault:
            raise NotReady(str(fault)) from fault


def address(text: str) -> Address:
    """Return host and port of a text such as 127.0.0.1:6653; raise BadConfig if it is none."""
    host, _colon, port = text.rpartition(":")
    if not host or not port.isdecimal():
        raise BadConfig(f"{text!r} is not an address; write it as 127.0.0.1:6653")
    return host, int(port)
