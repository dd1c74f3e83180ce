"""Take part in a service: ask a host for it, or wait for a host that asks.

Prints a line of JSON for each result, and one with the summary at the end.
"""

import argparse
import json
import sys
from typing import Any

from hosts.service_socket import ServiceSocket
from hosts.stack_socket import QuantumSocketError


def ask(arguments: argparse.Namespace) -> None:
    """Ask the host for the service."""
    with ServiceSocket(arguments.stack) as asking:
        address = arguments.host, arguments.port
        for result in asking.request(arguments.service, address, **arguments.options):
            report("result", result)
        asking.shutdown()
        report("done", asking.summary)


def wait(arguments: argparse.Namespace) -> None:
    """Wait for one host that asks."""
    with ServiceSocket(arguments.stack) as listener:
        listener.listen(arguments.port, arguments.service)
        report("listening", {"port": arguments.port})
        connection, peer = listener.accept()
    with connection:
        while not connection.over:
            for result in connection.results():
                report("result", result)
        report("done", {"peer": peer, **connection.summary})


def report(event: str, fields: dict[str, Any]) -> None:
    """Print one line of JSON."""
    print(json.dumps({"event": event, **fields}), flush=True)


def options_of(text: str) -> dict[str, Any]:
    """Return the options that are given as JSON; raise ValueError for anything else."""
    options = json.loads(text)
    if not isinstance(options, dict):
        raise TypeError("no JSON object")
    return options


def main() -> int:
    """Read the arguments, take part, and turn faults into one line and an exit status."""
    parser = argparse.ArgumentParser(
        prog="python -m hosts.applications.service", description=__doc__
    )
    parser.add_argument("--stack", help="socket of this host's stack (QMN_STACK)")
    parser.add_argument("service", help="its name, as teleport")
    parser.add_argument("port", type=int)
    parser.add_argument("host", nargs="?", help="to ask; without it: wait to be asked")
    parser.add_argument("--options", type=options_of, default={}, help="of the service, as JSON")
    arguments = parser.parse_args()
    try:
        if arguments.host is None:
            wait(arguments)
        else:
            ask(arguments)
    except QuantumSocketError as error:
        print(json.dumps({"event": "failed", "reason": error.reason.name, "text": str(error)}))
        print(f"service: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
