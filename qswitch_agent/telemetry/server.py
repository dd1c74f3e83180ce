"""Serves a switch's telemetry beside what the agent does.

The server of gRPC has a Unix socket: gRPC cannot be given a TCP socket that listens already.
"""

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from functools import partial

import grpc
from pygnmi.spec.v080.gnmi_pb2_grpc import add_gNMIServicer_to_server

from programs.connection_shares import StreamServer, grpc_options
from programs.metrics import inherited
from programs.relay import relay
from qswitch_agent.switch import Switch
from qswitch_agent.telemetry.open_config import Fiber, Observed, leaves
from qswitch_agent.telemetry.service import Telemetry
from qswitch_agent.telemetry.tree import Leaf
from wire.config import AgentConfig, BadConfig

MAX_REQUEST_BYTES = 1 << 18
OPTIONS = [("grpc.so_reuseport", 0), ("grpc.max_receive_message_length", MAX_REQUEST_BYTES)]


async def observe(switch: Switch, name: str) -> list[Leaf]:
    readings = await switch.read()
    fibers = {
        number: Fiber(port.name, port.up, switch.light(number, readings))
        for number, port in switch.described.items()
    }
    standing = [path for path in switch.paths.standing if {*path[:2]} <= fibers.keys()]
    return leaves(Observed(name, fibers, readings, standing, switch.path_optics()))


@asynccontextmanager
async def serving(config: AgentConfig, switch: Switch) -> AsyncIterator[None]:
    """Answer at the configured sockets meanwhile."""
    assert config.gnmi_fd is not None
    place = f"unix:{config.gnmi}"
    server = grpc.aio.server(options=[*OPTIONS, *grpc_options()])
    telemetry = Telemetry(partial(observe, switch, config.switch))
    add_gNMIServicer_to_server(telemetry, server)
    try:
        if config.credentials is None:
            server.add_insecure_port(place)
        else:
            authority, certificate, private_key = config.credentials.read()
            shown = [(private_key, certificate)]
            server.add_secure_port(place, grpc.ssl_server_credentials(shown, authority, True))
    except RuntimeError as error:
        raise BadConfig(f"cannot serve gNMI at {config.gnmi}: {error}") from error
    await server.start()
    connect = partial(asyncio.open_unix_connection, config.gnmi)
    entrance = StreamServer(lambda *near: relay(connect, near), inherited(config.gnmi_fd))
    try:
        yield
    finally:
        entrance.close()
        await server.stop(0)
