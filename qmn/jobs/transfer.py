"""One message from one host to another: start both applications, watch, collect the facts."""

import json
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from topologies.network import Network
from topologies.programs import POLL_S, NetworkError, Program, python

START_TIMEOUT_S = 15.0
STALL_TIMEOUT_S = 60.0
APPLICATION_PORT = 7


@dataclass(frozen=True)
class Transfer:
    """What to send and how."""

    file: Path
    output: Path
    sender: str = "alice"
    receiver: str = "bob"
    handshake: str = "framed"
    frame_bytes: int = 256
    block_pairs: int = 65_536
    rate_hz: int = 50_000_000
    fec: str = "none"
    interleave: bool = False


class TransferError(Exception):
    """The message did not arrive; the text says why and what to do."""


def transfer(
    network: Network, order: Transfer, progress: Callable[[dict[str, Any]], None]
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Send the file; return the last words of sender and receiver, decoded.

    Raise TransferError if it did not arrive, NetworkError if the network failed.
    """
    try:
        receiver = _start_receiver(network, order)
        sender = _start_sender(network, order)
        sent = follow(network, sender, progress)
        received = follow(network, receiver, lambda _line: None)
    except (TransferError, NetworkError):
        network.explain()
        raise
    return sent, received


def _start_receiver(network: Network, order: Transfer) -> Program:
    stack = network.runtime.socket(order.receiver)
    command = ["hosts.applications.receive", "--stack", stack, "--output", str(order.output)]
    program = network.run_on(
        order.receiver, "receiver", [python(), "-m", *command, str(APPLICATION_PORT)]
    )
    program.wait_for("listening", START_TIMEOUT_S)
    return program


def _start_sender(network: Network, order: Transfer) -> Program:
    options = {
        "--stack": network.runtime.socket(order.sender),
        "--file": order.file,
        "--handshake": order.handshake,
        "--frame-bytes": order.frame_bytes,
        "--block-pairs": order.block_pairs,
        "--rate-hz": order.rate_hz,
        "--fec": order.fec,
    }
    words = [str(word) for option in options.items() for word in option]
    words += ["--interleave"] if order.interleave else []
    command = [python(), "-m", "hosts.applications.send", *words]
    return network.run_on(order.sender, "sender", [*command, order.receiver, str(APPLICATION_PORT)])


def follow(
    network: Network, program: Program, progress: Callable[[dict[str, Any]], None]
) -> dict[str, Any]:
    """Read a program's lines of JSON until its last; every wait here has a deadline."""
    limit_s = network.runtime.time.wall_s(STALL_TIMEOUT_S)
    position, deadline = 0, time.monotonic() + limit_s
    while True:
        ended = not program.running  # asked first, so that no line after it is missed
        with program.log.open("rb") as log:
            log.seek(position)
            text = log.read().decode(errors="replace")
        complete = text[: text.rfind("\n") + 1]
        position += len(complete.encode())
        for line in complete.splitlines():
            deadline = time.monotonic() + limit_s
            fields = _fields(line)
            if fields.get("event") == "failed":
                raise TransferError(str(fields["text"]))
            if fields.get("event") == "done":
                return fields
            if fields:
                progress(fields)
        network.check()
        if ended:
            raise TransferError(f"{program.name} ended: {program.end()}")
        if time.monotonic() > deadline:
            raise NetworkError(
                f"{program.name} made no progress for {limit_s:g} s; "
                "is the loss of the fibres too high?"
            )
        time.sleep(POLL_S)


def _fields(line: str) -> dict[str, Any]:
    try:
        fields = json.loads(line)
    except ValueError:
        return {}
    return fields if isinstance(fields, dict) else {}
