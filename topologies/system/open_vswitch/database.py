"""Questions to Open vSwitch's database that change nothing, at its socket (JSON-RPC, RFC 7047).

To ask it so takes a hundredth of the time that `ovs-vsctl` takes to start.
"""

import json
import socket
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from topologies.system.processes.programs import NetworkError
from topologies.timeouts import COMMAND_LOOK_S

NAME = "Open_vSwitch"
UNREACHABLE = "database connection failed"  # as ovs-vsctl says it
CHUNK_BYTES = 1 << 16


def select(
    path: Path, table: str, columns: list[str], timeout_s: float, check: Callable[[], None]
) -> list[dict[str, Any]]:
    """Return these columns of all rows of a table, as RFC 7047 writes them (section 5.1)."""
    chosen = {"op": "select", "table": table, "where": [], "columns": columns}
    answer, *_ = ask(path, "transact", [NAME, chosen], timeout_s, check)
    if "rows" not in answer:
        raise NetworkError(f"{path}: {table} cannot be read: {answer}")
    rows: list[dict[str, Any]] = answer["rows"]
    return rows


def ask(
    path: Path,
    method: str,
    parameters: list[Any],
    timeout_s: float,
    check: Callable[[], None] = lambda: None,
) -> Any:
    """Return the result of a method; raise NetworkError if there is none in time.

    Meanwhile `check` is called, as by a command that is waited for (commands.run).
    """
    deadline, heard = time.monotonic() + timeout_s, b""
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as channel:
        channel.settimeout(COMMAND_LOOK_S)
        try:
            channel.connect(str(path))
            channel.sendall(json.dumps({"method": method, "params": parameters, "id": 0}).encode())
            while (answer := _whole(heard)) is None:
                try:
                    data = channel.recv(CHUNK_BYTES)
                except TimeoutError:
                    check()
                    if time.monotonic() > deadline:
                        raise
                    continue
                if not data:
                    raise ConnectionResetError("it has closed the connection")
                heard += data
        except TimeoutError as error:
            raise NetworkError(f"{path} did not answer in {timeout_s:g} s") from error
        except OSError as error:
            raise NetworkError(f"{path}: {UNREACHABLE} ({error.strerror or error})") from error
    if answer["error"] is not None:
        raise NetworkError(f"{path}: {method} failed: {answer['error']}")
    return answer["result"]


def _whole(heard: bytes) -> Any:
    """Return the whole message; None while its end is missing."""
    try:
        return json.loads(heard)
    except ValueError:
        return None
