"""Serves a switch's telemetry at an address, beside what the agent does."""

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from functools import partial

import grpc
from pygnmi.spec.v080.gnmi_pb2_grpc import add_gNMIServicer_to_server

from qswitch_agent.switch import Switch
from qswitch_agent.telemetry.open_config import Fiber, Observed, leaves
from qswitch_agent.telemetry.service import Telemetry
from qswitch_agent.telemetry.tree import Leaf
from wire.config import AgentConfig, BadConfig

MAX_REQUEST_BYTES = 1 << 18
OPTIONS = [("grpc.so_reuseport", 0), ("grpc.max_receive_message_length", MAX_REQUEST_BYTES)]


async def observe(switch: Switch, name: str) -> list[Leaf]:
    """Return all that is known of a switch now."""
    readings = await switch.read()
    fibers = {
        number: Fiber(port.name, port.up, switch.light(number, readings))
        for number, port in switch.described.items()
    }
    standing = [path for path in switch.paths.standing if {*path[:2]} <= fibers.keys()]
    return leaves(Observed(name, fibers, readings, standing, switch.path_optics()))


@asynccontextmanager
async def serving(config: AgentConfig, switch: Switch) -> AsyncIterator[None]:
    """Answer at the configured address meanwhile, if there is one."""
    server = grpc.aio.server(options=OPTIONS)
    telemetry = Telemetry(partial(observe, switch, config.switch))
    add_gNMIServicer_to_server(telemetry, server)
    try:
        if config.credentials is None:
            server.add_insecure_port(config.gnmi)
        else:
            authority, certificate, private_key = config.credentials.read()
            shown = [(private_key, certificate)]
            server.add_secure_port(config.gnmi, grpc.ssl_server_credentials(shown, authority, True))
    except RuntimeError as error:
        raise BadConfig(f"cannot serve gNMI on {config.gnmi}: is the port taken?") from error
    await server.start()
    try:
        yield
    finally:
        await server.stop(0)
