"""The controller's console, on a Unix socket for its owner alone (wire/controller_lines.py)."""

import logging
import os
import socket
from contextlib import closing
from pathlib import Path

from controller_apps.console.facts import Facts, perform
from controller_apps.console.questions import Refused
from controller_apps.openflow.framework import EndOnFault, hub
from controller_apps.timeouts import REQUEST_TIMEOUT_S
from wire.controller_lines import MAX_REQUEST, decode_request, encode_error, encode_result
from wire.malformed import MalformedPacket

BACKLOG = 16
log = logging.getLogger("console")


class Console:
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
        hub.spawn(self.serve, facts)

    def serve(self, facts: Facts) -> None:
        with EndOnFault("console"):
            while True:
                connection, _ = self._listener.accept()
                with closing(connection):
                    _serve(connection, facts)


def _serve(connection: socket.socket, facts: Facts) -> None:
    connection.settimeout(REQUEST_TIMEOUT_S)
    try:
        connection.sendall(_answer(_read_line(connection), facts))
    except OSError as error:  # TimeoutError is one
        log.info("a connection ended: %s", error)


def _answer(line: bytes, facts: Facts) -> bytes:
    try:
        return encode_result(perform(facts, decode_request(line)))
    except (MalformedPacket, Refused) as error:
        return encode_error(str(error))


def _read_line(connection: socket.socket) -> bytes:
    """Return what comes up to the first line end, or more than fits."""
    line = b""
    while b"\n" not in line and len(line) <= MAX_REQUEST:
        data = connection.recv(MAX_REQUEST)
        if not data:
            break
        line += data
    return line
