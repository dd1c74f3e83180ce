"""python -m dispatcher --config FILE"""

import logging
import os
import sys

# gRPC's own lines about a taken port would hide ours; it reads this when imported.
os.environ.setdefault("GRPC_VERBOSITY", "NONE")

import uvloop

from dispatcher.server.server import serve
from programs.config_argument import config_path
from programs.faults import report_fault
from wire.config import BadConfig, DispatcherConfig
from wire.parameters.physics import BadParameter


def main() -> int:
    """Run the dispatcher; return its exit status."""
    path = config_path("dispatcher", "Hold all qubits of a network.")
    logging.basicConfig(
        stream=sys.stderr, level=logging.INFO, format="%(asctime)s %(levelname)s %(message)s"
    )
    try:
        uvloop.run(serve(DispatcherConfig.read(path)))
    except (BadConfig, BadParameter, OSError) as error:
        return report_fault(f"dispatcher: {error}")
    return 0


if __name__ == "__main__":
    status = main()
    sys.stdout.flush()
    # gRPC would wait for calls whose watchers do not read; what there is to write is written.
    os._exit(status)
