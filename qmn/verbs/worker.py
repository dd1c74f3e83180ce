"""qmn worker SCHEDULER: offer this machine, a Dask worker, to networks over several machines.

All who reach the scheduler can run programs here, as root.
"""

import argparse
import asyncio
import logging
import socket
import sys
from contextlib import suppress
from typing import Any
from urllib.parse import urlsplit

from qmn.needs import Needs
from qmn.timeouts import CLUSTER_TIMEOUT_S
from topologies.networks.requirements import require_root
from topologies.system.processes.programs import NetworkError

SCHEMES = ("tcp", "tls")


def add_parser(verbs: Any) -> None:
    parser = verbs.add_parser("worker", description=__doc__)
    add = parser.add_argument
    add("scheduler", metavar="tcp://…", help="Dask's scheduler, or tls://… with Dask's settings")
    add("--name", default=socket.gethostname(), help="of this machine (that of the host)")
    add("--listen", default="", metavar="ADDRESS", help="of this machine (on the way there)")
    parser.set_defaults(call=call, needs=Needs.ROOT)


def call(arguments: argparse.Namespace) -> int:
    try:
        check_address(arguments.scheduler)
        require_root()
        asyncio.run(serve(arguments.scheduler, arguments.name, arguments.listen))
    except (NetworkError, OSError, ValueError) as error:
        print(f"qmn: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        return 130
    return 0


def check_address(scheduler: str) -> None:
    """Raise ValueError for what cannot be the address of a scheduler: Dask ends in tracebacks."""
    with suppress(ValueError):  # urlsplit's words do not say what to write
        parts = urlsplit(scheduler)
        if parts.scheme in SCHEMES and parts.hostname and parts.port:
            return
    raise ValueError(f"scheduler {scheduler!r}: write tcp://HOST:PORT, or tls://HOST:PORT")


async def serve(scheduler: str, name: str, listen: str) -> None:
    """Be a worker; raise NetworkError if it cannot start."""
    # Dask takes a second to load: other verbs do not wait for it.
    from distributed import Worker

    worker = Worker(
        scheduler,
        name=name,
        host=listen or None,
        nthreads=1,
        memory_limit=0,
        dashboard=False,
        death_timeout=CLUSTER_TIMEOUT_S,
    )
    logging.disable()  # what keeps a worker from starting is raised, and logged as well
    try:
        await worker
    except TimeoutError as error:
        raise NetworkError(
            f"no Dask scheduler answers at {scheduler}: start `dask scheduler` there"
        ) from error
    except RuntimeError as error:
        raise NetworkError(f"the worker cannot start: {error.__cause__ or error}") from error
    finally:
        logging.disable(logging.NOTSET)
    async with worker:
        print(f"ready: {name} at {worker.address}", flush=True)
        await worker.finished()
