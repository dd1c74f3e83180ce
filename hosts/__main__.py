"""Run one host's stack: python -m hosts --config FILE."""

import asyncio
import logging
import os
import signal
import socket
import sys
from asyncio import FIRST_COMPLETED
from pathlib import Path

from hosts import network_loop
from hosts.hardware.announce import announce
from hosts.hardware.simulated import SimulatedQnic, chosen_qnic
from hosts.node_agent import start_node_agent
from hosts.serving import processing
from hosts.stack import Stack
from programs.config_argument import config_path
from programs.connection_shares import StreamServer
from programs.faults import report_fault
from wire.config import BadConfig, HostConfig
from wire.metadata.header import METADATA_PORT

processing.preload()


async def run(config: HostConfig) -> None:
    """Serve until a signal to stop; if one part fails, all end."""
    qnic = chosen_qnic(config)
    stack = Stack(config, qnic)
    stopped = asyncio.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        asyncio.get_running_loop().add_signal_handler(number, stopped.set)
    # asyncio would look addresses up by names, in four threads of their own.
    serves = {METADATA_PORT: stack.serve}
    if stack.unit is not None:
        serves[stack.unit.port] = stack.unit.serve_unit
    servers = [
        StreamServer(serve, socket.create_server((config.address, port)))
        for port, serve in serves.items()
    ]
    local = await asyncio.start_unix_server(stack.applications.serve, config.socket)
    announcing = announce(config, lambda: stack.device.subscribed)
    speaking = [asyncio.create_task(announcing)]
    stopping = asyncio.create_task(stopped.wait())
    if config.device_key:
        agent = await start_node_agent(config, stack.device, stack.link_monitors, stack.takes_part)
        speaking.append(asyncio.create_task(agent.run()))
        if config.time_folder and isinstance(qnic, SimulatedQnic):
            connecting = asyncio.create_task(connect(qnic, agent.found))
            await asyncio.wait([connecting, stopping, *speaking], return_when=FIRST_COMPLETED)
            connecting.cancel()
    print("ready", flush=True)
    await asyncio.wait([stopping, *speaking], return_when=FIRST_COMPLETED)
    for task in speaking:
        if task.done():
            task.result()
        task.cancel()
    for server in servers:
        server.close()
    local.close()
    await qnic.close()
    Path(config.socket).unlink(missing_ok=True)


async def connect(qnic: SimulatedQnic, found: asyncio.Event) -> None:
    """Connect to the dispatcher before time is stepped, which would leap meanwhile.

    Nothing passes the switches until the controller has found this host.
    """
    await found.wait()
    await qnic.connect()


def main() -> int:
    path = config_path("python -m hosts", __doc__)
    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(name)s %(levelname)s %(message)s")
    try:
        config = HostConfig.read(path)
        network_loop.run(run(config), config.time)
    except (BadConfig, OSError) as error:
        return report_fault(f"host stack: {error}")
    return 0


if __name__ == "__main__":
    status = main()
    sys.stdout.flush()
    # All is closed: to take the interpreter apart as well would take longer than to end.
    os._exit(status)
