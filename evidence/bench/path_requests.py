"""Light paths asked for one after the other, by a host, without any light.

python -m evidence.bench.path_requests COUNT RECEIVER SOURCE LOG

Prints the seconds of all. LOG is the dispatcher's, which is written some milliseconds late; its
times, of this machine's clock, prove that cross-connects opened before the receiver answered, and
tell when they were closed, so that each set-up is for itself. Nobody listens at the receiver's
port, which refuses a session only after the controller has granted it.
"""

import argparse
import socket
import time
from datetime import datetime
from pathlib import Path
from typing import BinaryIO

from qmn.timeouts import CLOSE_TIMEOUT_S, PATH_POLL_S, TURN_TIMEOUT_S
from wire.malformed import MalformedPacket
from wire.metadata.decoding import decode, message_length
from wire.metadata.header import METADATA_PORT, session_number
from wire.metadata.setup import Answer, Setup
from wire.metadata.vocabulary import Handshake, Reason, Service

CHUNK = 4096


class NoPath(Exception):
    """A path was not made, or not closed, as it should have been."""


class Openings:
    """Follows the dispatcher's log: how many cross-connects were opened, and how many closed.

    Also when the last of these were, in ns since 1970.
    """

    def __init__(self, log: BinaryIO) -> None:
        log.seek(0, 2)
        self._log = log
        self._rest = b""
        self.opened = self.closed = 0
        self.opened_ns = self.closed_ns = 0

    def read(self) -> None:
        """Take in what has been written since the last time."""
        *lines, self._rest = (self._rest + self._log.read()).split(b"\n")
        for fields in map(bytes.split, lines):
            kind = fields[2] if len(fields) > 2 else b""
            if kind == b"open":
                self.opened, self.opened_ns = self.opened + 1, time_ns(fields[0].decode())
            elif kind == b"close":
                self.closed, self.closed_ns = self.closed + 1, time_ns(fields[0].decode())


def time_ns(text: str) -> int:
    """Return a time of the log, such as 2026-11-22T15:23:39.978776440Z, in ns since 1970."""
    seconds, _point, fraction = text.removesuffix("Z").partition(".")
    return int(datetime.fromisoformat(f"{seconds}+00:00").timestamp()) * 10**9 + int(fraction)


def ask(place: int, receiver: str, source: str, service: Service = Service.SDC) -> socket.socket:
    """Return a connection whose set-up message the controller has granted; the host's next one."""
    connection = socket.socket()
    connection.settimeout(TURN_TIMEOUT_S)
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_QUICKACK, 0)  # as hosts' stacks do
    connection.connect((receiver, METADATA_PORT))
    session = session_number(connection.getsockname()[0], place)
    setup = Setup(session, service, Handshake.FRAMED, source, 64, 64, 1_000_000)
    connection.sendall(setup.encode())
    answer = answered(connection)
    if answer.session != session or answer.reason != Reason.NO_LISTENER:
        connection.close()
        raise NoPath(f"{Reason(answer.reason).name}: {answer.text}")
    return connection


def answered(connection: socket.socket) -> Answer:
    """Return the receiver's answer; raise NoPath if something else comes."""
    data = b""
    while (length := message_length(data)) is None or len(data) < length:
        chunk = connection.recv(CHUNK)
        if not chunk:
            raise NoPath("the receiver closed without an answer")
        data += chunk
    message = decode(data[:length])
    if not isinstance(message, Answer):
        raise NoPath(f"{type(message).__name__} instead of an answer")
    return message


def wait_until_closed(openings: Openings, before: int) -> None:
    """Return when more was opened than before, and all of it is closed again."""
    deadline = time.monotonic() + CLOSE_TIMEOUT_S
    openings.read()
    while openings.opened == before or openings.closed < openings.opened:
        if time.monotonic() > deadline:
            left = openings.opened - openings.closed
            if openings.opened == before:
                raise NoPath(f"no cross-connect has opened in {CLOSE_TIMEOUT_S:g} s")
            raise NoPath(f"{left} cross-connects stay open after {CLOSE_TIMEOUT_S:g} s")
        time.sleep(PATH_POLL_S)
        openings.read()


def requests(count: int, receiver: str, source: str, openings: Openings) -> float:
    first = time.time_ns()  # sessions that nobody else has
    took_ns = 0
    for place in range(first, first + count):
        before, asked_ns = openings.opened, time.time_ns()
        connection = ask(place, receiver, source)
        answered_ns = time.time_ns()
        connection.close()
        wait_until_closed(openings, before)
        if openings.opened_ns > answered_ns:
            raise NoPath("a session was answered before its cross-connects opened")
        took_ns += openings.closed_ns - asked_ns
    return took_ns / 1e9


def main() -> None:
    parser = argparse.ArgumentParser(
        prog="python -m evidence.bench.path_requests", description=__doc__
    )
    parser.add_argument("count", type=int)
    parser.add_argument("receiver", help="its IPv4 address")
    parser.add_argument("source", help="the pair source's")
    parser.add_argument("log", type=Path)
    arguments = parser.parse_args()
    with arguments.log.open("rb") as log:
        try:
            seconds = requests(arguments.count, arguments.receiver, arguments.source, Openings(log))
        except (OSError, MalformedPacket, NoPath) as error:
            raise SystemExit(f"path requests to {arguments.receiver}: {error}") from error
    print(f"seconds {seconds:.9f}", flush=True)


if __name__ == "__main__":
    main()
