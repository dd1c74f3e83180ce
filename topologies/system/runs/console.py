"""Questions to the controller, each over a connection of its own to its console."""

import socket
from pathlib import Path
from typing import Any

from topologies.timeouts import CONSOLE_TIMEOUT_S
from wire.controller_lines import decode_answer, encode_request

CHUNK = 1 << 16


def answer_of(console: Path, command: str, **fields: Any) -> Any:
    """Return the answer; raise ConsoleError for a refusal, OSError or MalformedPacket for none."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as connection:
        connection.settimeout(CONSOLE_TIMEOUT_S)
        connection.connect(str(console))
        connection.sendall(encode_request(command, **fields))
        return decode_answer(b"".join(iter(lambda: connection.recv(CHUNK), b"")))
