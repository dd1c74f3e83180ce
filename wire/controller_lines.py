"""The lines of JSON of the controller: its console's questions and answers, and its record.

The lines of the controller's console: a request of JSON, and its answer, one a connection.

{"command": "set", "device": "alice", "settings": {"rate_hz": 1000000}}  ->  {"result": ...}
{"command": "nonsense"}                                                  ->  {"error": "no ..."}
"""

import json
import os
from pathlib import Path
from typing import Any, BinaryIO

from wire.malformed import MalformedPacket

MAX_REQUEST = 4096  # bytes, the line end included
RECORD = "controller.jsonl"
EARLIER = ".1"  # behind the name: what was before, if there has been much


class ConsoleError(Exception):
    """The controller's refusal of a request, in its words."""


def encode_request(command: str, **fields: Any) -> bytes:
    return json.dumps({"command": command, **fields}).encode() + b"\n"


def decode_request(line: bytes) -> object:
    """Return what a line asks for; raise MalformedPacket if it is too long, or not JSON."""
    if len(line) > MAX_REQUEST or not line.endswith(b"\n"):
        raise MalformedPacket(f"a request is one line of at most {MAX_REQUEST} bytes")
    try:
        return json.loads(line)
    except (ValueError, RecursionError) as error:
        raise MalformedPacket(f"the request is not JSON: {error}") from error


def encode_result(result: Any) -> bytes:
    return json.dumps({"result": result}).encode() + b"\n"


def encode_error(text: str) -> bytes:
    return json.dumps({"error": text}).encode() + b"\n"


def decode_answer(line: bytes) -> Any:
    """Return the result; raise ConsoleError for a refusal, MalformedPacket for anything else."""
    try:
        answer = json.loads(line)
    except (ValueError, RecursionError) as error:
        raise MalformedPacket(f"the answer is not JSON: {error}") from error
    match answer:
        case {"result": result}:
            return result
        case {"error": str(text)}:
            raise ConsoleError(text)
    raise MalformedPacket("the answer has neither a result nor an error")


def fact_line(time_ns: int, event: str, **fields: Any) -> bytes:
    return json.dumps({"time_ns": time_ns, "event": event, **fields}).encode() + b"\n"


class NewFacts:
    """The facts of a record that is being written, each once."""

    def __init__(self, folder: Path) -> None:
        self._path = folder / RECORD
        self._file: BinaryIO | None = None
        self._rest = b""  # of a line still being written

    def close(self) -> None:
        if self._file is not None:
            self._file.close()

    def read(self) -> list[dict[str, Any]]:
        """Return the facts that have come since the last time, none before there is a file."""
        text = self._rest + (self._file.read() if self._file is not None else b"")
        if self._is_another():  # what is in the one before was read above
            self.close()
            self._file = self._path.open("rb")
            text += self._file.read()
        *lines, self._rest = text.split(b"\n")
        return [json.loads(line) for line in lines]

    def _is_another(self) -> bool:
        try:
            there = self._path.stat()
        except FileNotFoundError:
            return False
        return self._file is None or os.fstat(self._file.fileno()).st_ino != there.st_ino


def read_record(folder: Path) -> list[dict[str, Any]]:
    """Return the facts that are kept, oldest first; a line still being written is left out.

    Raise MalformedPacket for what is not a fact.
    """
    files = (folder / f"{RECORD}{EARLIER}", folder / RECORD)
    data = b"".join(file.read_bytes() for file in files if file.exists())
    return [_fact(line, folder) for line in data[: data.rfind(b"\n") + 1].splitlines()]


def _fact(line: bytes, folder: Path) -> dict[str, Any]:
    try:
        fact = json.loads(line)
    except (ValueError, RecursionError) as error:
        raise MalformedPacket(f"{folder / RECORD}: a line is not JSON: {error}") from error
    match fact:
        case {"time_ns": int(), "event": str()}:
            checked: dict[str, Any] = fact
            return checked
    raise MalformedPacket(f"{folder / RECORD}: a line has no time_ns and event: {line[:80]!r}")
