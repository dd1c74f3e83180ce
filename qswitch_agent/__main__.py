"""`python -m qswitch_agent --config FILE`: the agent of one quantum switch."""

import asyncio
import logging
import os
import signal
import sys
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

import uvloop

from programs.config_argument import config_path
from programs.faults import report_fault
from qswitch_agent.agent import Agent
from qswitch_agent.bridge import BridgeFault
from qswitch_agent.hardware.optics import HardwareFault, OpticalHardware
from qswitch_agent.hardware.simulated import SimulatedSwitch
from wire.config import AgentConfig, BadConfig
from wire.registered import INSTRUMENTS, BadPackage, load, registered


def hardware(config: AgentConfig) -> OpticalHardware:
    """Return the driver; raise BadConfig if the configuration names none that can be."""
    if not config.hardware:
        if config.hardware_ports:
            raise BadConfig("hardware_ports are given without hardware; name the instrument, too")
        return SimulatedSwitch(config.switch, config.dispatcher, config.token, config.time)
    if config.time_scale != 1 or config.time_folder:
        clock = "stepped time" if config.time_folder else f"time scale {config.time_scale:g}"
        raise BadConfig(
            f"{clock} with hardware {config.hardware}: an instrument runs in real time; "
            "leave it out"
        )
    parts = {"analysers": config.analysers, "memories": config.memories, "sources": config.sources}
    for name, number in parts.items():
        if number:
            raise BadConfig(
                f"{number} {name} with hardware {config.hardware}: an instrument of "
                "mirrors has none; leave them out, or let the switch be simulated"
            )
    drivers = registered(INSTRUMENTS)
    driver = drivers.get(config.hardware.partition("://")[0])
    if driver is None:
        ways = " or ".join(f"{name}://HOST:PORT" for name in drivers)
        raise BadConfig(
            f"hardware {config.hardware!r} is not known; leave it empty for the simulated switch"
            f"{f' or write {ways}' if ways else ''}"
        )
    instrument: OpticalHardware = load(driver)(config)
    return instrument


async def serve(config: AgentConfig) -> None:
    """Run the agent over the hardware that its configuration names, until SIGTERM or SIGINT."""
    stop = asyncio.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        asyncio.get_running_loop().add_signal_handler(number, stop.set)
    optics = hardware(config)
    try:
        async with measured(config, optics) as used:
            await Agent(config, used).run(stop)
    finally:
        await optics.close()


@asynccontextmanager
async def measured(config: AgentConfig, optics: OpticalHardware) -> AsyncIterator[OpticalHardware]:
    """Give the hardware; tell Prometheus its figures meanwhile, if that is configured."""
    if config.metrics_fd is None:
        yield optics
        return
    from programs.metrics import inherited
    from programs.metrics_server import serve as serve_metrics
    from qswitch_agent.metrics import MeasuredHardware

    used = MeasuredHardware(optics)
    endpoint = serve_metrics(inherited(config.metrics_fd), used.registry)
    try:
        yield used
    finally:
        endpoint.close()


def main() -> int:
    """Return 0 after a signal, 1 after a fault, which one line on stderr names."""
    path = config_path("qswitch_agent", __doc__)
    logging.basicConfig(
        format="%(asctime)s %(levelname)s %(message)s", level=logging.INFO, stream=sys.stderr
    )
    faults: list[str] = []
    try:
        uvloop.run(serve(AgentConfig.read(path)))
    except* (BadConfig, BadPackage, BridgeFault, HardwareFault) as group:
        faults = [str(fault) for fault in group.exceptions]
    return report_fault(f"qswitch_agent: {faults[0]}") if faults else 0


if __name__ == "__main__":
    status = main()
    sys.stdout.flush()
    # All is closed: to take the interpreter apart as well would take longer than to end.
    os._exit(status)
