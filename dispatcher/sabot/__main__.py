"""python -m dispatcher.sabot --socket PATH: the simulation manager as a server of its own."""

import argparse
import os
import sys

# gRPC's own lines about a taken socket would hide ours; it reads this when imported.
os.environ.setdefault("GRPC_VERBOSITY", "NONE")

from programs.faults import report_fault
from wire.config import BadConfig
from wire.registered import SIMULATION_SERVERS, BadPackage, load, only

MAX_LIVE_QUBITS = 8_000_000


def main() -> int:
    """Run the server; return its exit status."""
    parser = argparse.ArgumentParser(
        prog="python -m dispatcher.sabot",
        description="Hold quantum states for a dispatcher or other programs (wire/sabot.proto).",
        epilog="The socket is made for its owner alone (mode 0600): that decides who may call.",
    )
    parser.add_argument("--socket", required=True, metavar="PATH", help="of the Unix socket")
    parser.add_argument(
        "--max-live-qubits",
        type=int,
        default=MAX_LIVE_QUBITS,
        metavar="N",
        help=f"of all workspaces ({MAX_LIVE_QUBITS})",
    )
    arguments = parser.parse_args()
    try:
        serve = load(only("python -m dispatcher.sabot", SIMULATION_SERVERS))
        serve(arguments.socket, arguments.max_live_qubits)
    except (BadConfig, BadPackage, OSError) as error:
        return report_fault(f"sabot: {error}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
