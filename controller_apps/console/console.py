"""The controller's console: a line of JSON on a unix socket, a line of JSON back.

    {"command": "devices"}                                  ->  {"result": [...]}
    {"command": "set", "device": "alice", "settings": {"rate_hz": 1000000}}
    {"command": "nonsense"}                                 ->  {"error": "no command ..."}

One request a connection. The socket is for its owner alone.
"""

import json
import logging
import os
import socket
from contextlib import closing
from pathlib import Path
from typing import Any

from controller_apps.console.facts import MAX_REQUEST, Facts, perform
from controller_apps.console.questions import Refused
from controller_apps.openflow.framework import EndOnFault, hub

REQUEST_TIMEOUT_S = 5.0
BACKLOG = 16
log = logging.getLogger("console")


class Console:
    """Serves one connection after the other, each with deadlines."""

    def __init__(self, path: str) -> None:
        """Open the socket; raise OSError if that cannot be."""
        Path(path).unlink(missing_ok=True)  # of a controller that was killed: it held our port
        self._listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        umask = os.umask(0o177)
        try:
            self._listener.bind(path)
        finally:
            os.umask(umask)
        self._listener.listen(BACKLOG)

    def start(self, facts: Facts) -> None:
        """Serve from now on, beside the apps."""
        hub.spawn(self.serve, facts)

    def serve(self, facts: Facts) -> None:
        """Serve for ever."""
        with EndOnFault("console"):
            while True:
                connection, _ = self._listener.accept()
                with closing(connection):
                    _serve(connection, facts)


def _serve(connection: socket.socket, facts: Facts) -> None:
    connection.settimeout(REQUEST_TIMEOUT_S)
    try:
        answer = _answer(_read_line(connection), facts)
        connection.sendall(json.dumps(answer).encode() + b"\n")
    except OSError as error:  # TimeoutError is one
        log.info("a connection ended: %s", error)


def _answer(line: bytes, facts: Facts) -> dict[str, Any]:
    try:
        return {"result": perform(facts, _decode(line))}
    except Refused as refused:
        return {"error": str(refused)}


def _read_line(connection: socket.socket) -> bytes:
    """Return what comes up to the first line end, or more than fits."""
    line = b""
    while b"\n" not in line and len(line) <= MAX_REQUEST:
        data = connection.recv(MAX_REQUEST)
        if not data:
            break
        line += data
    return line


def _decode(line: bytes) -> object:
    if len(line) > MAX_REQUEST or not line.endswith(b"\n"):
        raise Refused(f"a request is one line of at most {MAX_REQUEST} bytes")
    try:
        return json.loads(line)
    except (ValueError, RecursionError) as error:
        raise Refused(f"the request is not JSON: {error}") from error
