"""Take part in a service: ask a host for it, or wait for a host that asks.

Prints a line of JSON for each result, and one with the summary at the end.
"""

import argparse
import json
import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO

from hosts.applications.carrying import first_chunk, receive, say, send
from hosts.quantum_socket import QuantumSocket
from hosts.stack_socket import QuantumSocketError
from programs.faults import report_fault
from wire.network_time import REAL_TIME, NetworkTime, SteppedTime


@dataclass(frozen=True)
class Part:
    service: str
    port: int
    stack: str | None = None  # its socket; None: as the environment says
    host: str | None = None  # that is asked; None: this one is
    options: dict[str, Any] = field(default_factory=dict)  # of the service, for who asks
    file: BinaryIO | None = None  # to send, if the service carries bytes
    output: Path | BinaryIO | None = None  # for the bytes that come
    time_scale: float = 1.0  # of the network, in whose seconds reports are
    time_folder: str = ""  # of the gate that steps its time; empty: paced


def ask(part: Part) -> None:
    """Ask the host for the service; send the file, if there is one."""
    assert part.host is not None
    with QuantumSocket(part.stack) as asking:
        for result in asking.request(part.service, (part.host, part.port), **part.options):
            say("result", result)
        if part.file is not None:
            send(asking, part.file, first_chunk(part.options), time_of(part))
        else:
            asking.shutdown()
            say("done", asking.summary)


def time_of(part: Part) -> NetworkTime:
    """Return the time of the network; stepped, its seconds count from now."""
    return clock_of(part.time_folder) if part.time_folder else NetworkTime(part.time_scale)


def clock_of(folder: str) -> NetworkTime:
    """Return the time that is stepped by the gate of a folder, from now on; without one: paced."""
    if not folder:
        return REAL_TIME
    return SteppedTime(1.0, SteppedTime(folder=folder).now_ns(), folder)


def wait(part: Part, listening: Callable[[], None] | None = None) -> None:
    """Wait for one host that asks; receive into the output file, if there is one.

    `listening` is called as soon as hosts can ask.
    """
    with QuantumSocket(part.stack) as listener:
        listener.listen(part.port, part.service)
        say("listening", {"port": part.port})
        if listening is not None:
            listening()
        connection, peer = listener.accept()
    with connection:
        if part.output is not None:
            receive(connection, peer, part.output)
            return
        while not connection.over:
            for result in connection.results():
                say("result", result)
        say("done", {"peer": peer, **connection.summary})


def ended_well(name: str, work: Callable[[], None]) -> int:
    """Do the work of a program; turn a fault into one line and an exit status."""
    try:
        work()
    except QuantumSocketError as error:
        say("failed", {"reason": error.reason.name, "text": str(error)})
        return report_fault(f"{name}: {error}")
    return 0


def options_of(text: str) -> dict[str, Any]:
    """Return the options that are given as JSON; raise ValueError for anything else."""
    options = json.loads(text)
    if not isinstance(options, dict):
        raise TypeError("not a JSON object")
    return options


def main() -> int:
    parser = argparse.ArgumentParser(
        prog="python -m hosts.applications.service", description=__doc__
    )
    parser.add_argument("--stack", help="socket of this host's stack (QMN_STACK)")
    parser.add_argument("service", help="its name, as teleport")
    parser.add_argument("port", type=int)
    parser.add_argument("host", nargs="?", help="to ask; without it: wait to be asked")
    parser.add_argument("--options", type=options_of, default={}, help="of the service, as JSON")
    text = "of bytes to send, for a service that carries some"
    parser.add_argument("--file", type=argparse.FileType("rb"), default=None, help=text)
    text = "for the bytes that come, of a service that carries some"
    parser.add_argument("--output", type=Path, default=None, help=text)
    text = "seconds here for one of the network; times of bytes are the network's (1)"
    parser.add_argument("--time-scale", type=float, default=1.0, help=text)
    parser.add_argument("--time-folder", default="", help="of the gate that steps time")
    part = Part(**vars(parser.parse_args()))
    work = wait if part.host is None else ask
    return ended_well("service", lambda: work(part))


if __name__ == "__main__":
    sys.exit(main())
