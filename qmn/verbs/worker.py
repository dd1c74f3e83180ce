"""qmn worker SCHEDULER: offer this machine, a Dask worker, to networks over several machines.

Whoever reaches the scheduler can run programs here, as root.
"""

import argparse
import asyncio
import socket
import sys
from typing import Any

from qmn.timeouts import CLUSTER_TIMEOUT_S
from topologies.network import require_root
from topologies.programs import NetworkError


def add_parser(verbs: Any) -> None:
    """Describe the verb."""
    text = "offer this machine to networks over several"
    parser = verbs.add_parser("worker", help=text, description=__doc__)
    add = parser.add_argument
    add("scheduler", metavar="tcp://…", help="Dask's scheduler, or tls://… with Dask's settings")
    add("--name", default=socket.gethostname(), help="of this machine (that of the host)")
    add("--listen", default="", metavar="ADDRESS", help="of this machine (on the way there)")
    parser.set_defaults(call=call, needs_root=True)


def call(arguments: argparse.Namespace) -> int:
    """Serve until the scheduler ends it, or a signal does."""
    try:
        require_root()
        asyncio.run(serve(arguments.scheduler, arguments.name, arguments.listen))
    except (NetworkError, OSError, ValueError) as error:
        print(f"qmn: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        return 130
    return 0


async def serve(scheduler: str, name: str, listen: str) -> None:
    """Be a worker."""
    # Dask takes a second to load: other verbs do not wait for it.
    from distributed import Worker

    async with Worker(
        scheduler,
        name=name,
        host=listen or None,
        nthreads=1,
        memory_limit=0,
        dashboard=False,
        death_timeout=CLUSTER_TIMEOUT_S,
    ) as worker:
        print(f"ready: {name} at {worker.address}", flush=True)
        await worker.finished()
