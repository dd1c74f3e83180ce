"""Run one host's key manager: python -m applications.keys --config FILE."""

import asyncio
import logging
import os
import signal
import sys

from applications.keys.config import KeyManagerConfig
from applications.keys.delivery import KeyDelivery
from applications.keys.filling import fill, open_to_others
from applications.keys.link_states import KeyLinkStates
from applications.keys.other_managers import OtherManagers
from applications.keys.routes import open_routes
from applications.keys.sessions import StackGone
from applications.keys.web import serve
from applications.qkd.key_files import KeyStoreError
from hosts import network_loop
from programs.config_argument import config_path
from programs.faults import report_fault
from wire.config import BadConfig


async def run(config: KeyManagerConfig) -> None:
    """Serve, and keep stores filled, until a signal; if one part fails, all end."""
    stopped = asyncio.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        asyncio.get_running_loop().add_signal_handler(number, stopped.set)
    others = OtherManagers(config)
    delivery = KeyDelivery(config, others.tell, others.relay)
    links = KeyLinkStates(config, delivery)
    routes = await open_routes(config, links.all) if config.report_to else None
    delivery.router = routes
    server = serve(config, delivery)
    async with open_to_others(config):
        print("ready", flush=True)
        working = [asyncio.create_task(fill(config, delivery, links))]
        if routes is not None:
            working.append(asyncio.create_task(routes.run()))
        stopping = asyncio.create_task(stopped.wait())
        await asyncio.wait([stopping, *working], return_when=asyncio.FIRST_COMPLETED)
        for task in working:
            if task.done():
                task.result()
            task.cancel()
    server.stop()
    await server.close_all_connections()
    others.close()
    if routes is not None:
        routes.close()


def main() -> int:
    path = config_path("python -m applications.keys", __doc__)
    logging.getLogger("tornado.access").setLevel(logging.ERROR)  # deliveries are logged in words
    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(name)s %(levelname)s %(message)s")
    try:
        config = KeyManagerConfig.read(path)
        network_loop.run(run(config), config.time)
    except (BadConfig, KeyStoreError, StackGone, OSError) as error:  # ssl.SSLError is an OSError
        return report_fault(f"key manager: {error}")
    return 0


if __name__ == "__main__":
    status = main()
    sys.stdout.flush()
    os._exit(status)  # as a host's stack does
