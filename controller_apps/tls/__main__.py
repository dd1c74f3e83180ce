"""`python -m controller_apps.tls --config FILE`: let switches in to the controller by TLS."""

import asyncio
import logging
import signal
import sys

import uvloop

from controller_apps.tls.entrance import Entrance
from programs.config_argument import config_path
from programs.faults import report_fault
from wire.config import BadConfig, EntranceConfig


async def serve(config: EntranceConfig) -> None:
    stop = asyncio.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        asyncio.get_running_loop().add_signal_handler(number, stop.set)
    entrance = Entrance(config)
    await entrance.open()
    print("ready", flush=True)
    await stop.wait()
    entrance.close()


def main() -> int:
    """Return 0 after a signal, 1 if the entrance cannot be."""
    path = config_path("controller_apps.tls", __doc__)
    logging.basicConfig(
        stream=sys.stderr, level=logging.INFO, format="%(asctime)s %(name)s: %(message)s"
    )
    try:
        uvloop.run(serve(EntranceConfig.read(path)))
    except (BadConfig, OSError) as error:
        return report_fault(f"entrance: {error}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
