"""Sessions of every service in which something goes wrong, and what must be left of them: nothing.

A session of each service is small, but has several blocks, so that it can break in the middle.
"""

import asyncio
import re
from collections.abc import AsyncIterator, Awaitable, Callable
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import asynccontextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from dispatcher_status import require_nothing_left
from limits import SOON_S, until
from stacks_scene import Judge, grant, network

from hosts.quantum_socket import QuantumSocket
from hosts.service_socket import ServiceSocket
from hosts.stack import Stack
from hosts.stack_socket import QuantumSocketError, StackSocket
from wire.metadata.header import Message
from wire.metadata.vocabulary import Reason

PORT = 9
DATA = bytes(range(256))
KEYS = {"count": 3000, "block_pairs": 2500, "bound": "asymptotic"}
SESSIONS: dict[str, dict[str, Any]] = {
    "sdc": {"frame_bytes": 32, "block_pairs": 512},
    "teleport": {"count": 600, "block_pairs": 200},
    "distribute": {"count": 600, "block_pairs": 300},
    "bb84": KEYS,
    "bbm92": KEYS,
    "e91": KEYS,
    "mdi": KEYS,
    "ghz": {"count": 600, "block_pairs": 300, "line": "alice,bob"},
    "graph": {"count": 600, "block_pairs": 300, "line": "alice,bob"},
    "conference": {"count": 4000, "block_pairs": 2000, "line": "alice,bob"},
    "sense": {"count": 600, "block_pairs": 300, "line": "alice,bob"},
    "seal": {"count": 900, "block_pairs": 500},
}
SERVICES = list(SESSIONS)
PATHS = {
    "sdc": [(4, 1), (1, 3), (5, 2)],
    "bb84": [(1, 2)],
    "mdi": [(1, 4), (2, 5)],
    "ghz": [(1, 2)],
    "graph": [(1, 2)],
    "sense": [(1, 2)],
    "conference": [(1, 2)],
}  # of all others: pairs to both ends
PAIRS = [(4, 1), (5, 2)]
NOBODY = "there was no session"
# gRPC has one queue for all loops of a process: an answer to a call of an earlier test comes to
# the test that runs now.
ENDED_LOOP = re.compile(r"PollerCompletionQueue.*RuntimeError\('Event loop is closed'\)")

Fields = dict[str, Any]
Stacks = dict[str, Stack]
Sockets = dict[str, StackSocket]


@dataclass(frozen=True)
class Outcome:
    """The result of a session for an application."""

    error: QuantumSocketError | None
    summary: Fields

    @property
    def text(self) -> str:
        """Return what a person reads; "" if all was well."""
        return "" if self.error is None else str(self.error)


@asynccontextmanager
async def running(
    folder: Path, service: str, judge: Judge = grant, **physics: Any
) -> AsyncIterator[Stacks]:
    """Run the hosts that a service needs; in the end nothing of any session may be left."""
    problems: list[str] = []

    def note(_loop: asyncio.AbstractEventLoop, what: dict[str, Any]) -> None:
        text = f"{what['message']}: {what.get('exception')!r}"
        if not ENDED_LOOP.search(text):
            problems.append(text)

    asyncio.get_running_loop().set_exception_handler(note)
    stacks: Stacks = {}
    words = {"paths": PATHS.get(service, PAIRS), "stacks": stacks, **physics}
    async with network(folder, judge, **words):
        yield stacks
        await asyncio.to_thread(require_nothing_left, folder, [*stacks])
        await require_no_session(stacks)
    assert not problems, problems


async def require_no_session(stacks: Stacks) -> None:
    """Wait until no host takes part in anything, nor waits for light."""
    await until(lambda: not _under_way(stacks))


def _under_way(stacks: Stacks) -> list[str]:
    left = [task.get_name() for task in asyncio.all_tasks() if "light of" in task.get_name()]
    for name, stack in stacks.items():
        left += [f"{name}: session {session:016x}" for session in stack.active_sessions.sessions]
        report = stack.device.report()
        if report.sending or report.receiving or report.serving:
            left.append(f"{name}: {report}")
    return left


def session(
    folder: Path, service: str, sockets: Sockets | None = None, **options: Any
) -> tuple[Outcome, Outcome]:
    """Have a session of a service between alice and bob; return both results.

    Their sockets can be found in `sockets` meanwhile.
    """
    words = {**SESSIONS[service], **options}
    known: Sockets = {} if sockets is None else sockets
    with ThreadPoolExecutor(1) as pool:
        listening: Future[None] = Future()
        over: Future[Callable[[], None]] = Future()  # to end bob's waiting
        sent = words.get("data", DATA)
        take_part = partial(_receive, sent) if service == "sdc" else _accept
        bob = pool.submit(take_part, folder, service, known, listening, over)
        listening.result(SOON_S)
        ask = _send if service == "sdc" else _ask
        try:
            alice = ask(folder, service, known, words)
        finally:
            over.result(SOON_S)()
        return alice, bob.result(SOON_S)


async def takes_part(name: str, sockets: Sockets) -> StackSocket:
    """Return the socket of an application, which is perhaps only about to take part."""
    await until(lambda: name in sockets)
    return sockets[name]


def _ask(folder: Path, service: str, sockets: Sockets, options: Fields) -> Outcome:
    with ServiceSocket(folder / "alice.sock") as alice:
        alice.settimeout(SOON_S)
        sockets["alice"] = alice
        try:
            list(alice.request(service, ("bob", PORT), **options))
            alice.shutdown()
        except QuantumSocketError as error:
            return Outcome(error, alice.summary)
        return Outcome(None, alice.summary)


def _accept(
    folder: Path,
    service: str,
    sockets: Sockets,
    listening: "Future[None]",
    over: "Future[Callable[[], None]]",
) -> Outcome:
    with ServiceSocket(folder / "bob.sock") as listener:
        listener.settimeout(SOON_S)
        listener.listen(PORT, service)
        over.set_result(listener.close)
        listening.set_result(None)
        bob = _connection(listener)
        if bob is None:
            return Outcome(QuantumSocketError(NOBODY), {})
        bob.settimeout(SOON_S)
        sockets["bob"] = bob  # which may be closed from now on
        with bob:
            try:
                while not bob.over:
                    list(bob.results())
            except QuantumSocketError as error:
                return Outcome(error, bob.summary)
            return Outcome(None, bob.summary)


def _send(folder: Path, _service: str, sockets: Sockets, options: Fields) -> Outcome:
    with QuantumSocket(folder / "alice.sock") as alice:
        alice.settimeout(SOON_S)
        sockets["alice"] = alice
        try:
            data = options.pop("data", DATA)
            alice.connect(("bob", PORT), **options)
            alice.sendall(data)
            alice.shutdown()
        except QuantumSocketError as error:
            return Outcome(error, alice.statistics)
        return Outcome(None, alice.statistics)


def _receive(
    sent: bytes,
    folder: Path,
    _service: str,
    sockets: Sockets,
    listening: "Future[None]",
    over: "Future[Callable[[], None]]",
) -> Outcome:
    with QuantumSocket(folder / "bob.sock") as listener:
        listener.settimeout(SOON_S)
        listener.listen(PORT)
        over.set_result(listener.close)
        listening.set_result(None)
        bob = _connection(listener)
        if bob is None:
            return Outcome(QuantumSocketError(NOBODY), {})
        bob.settimeout(SOON_S)
        sockets["bob"] = bob
        got = b""
        with bob:
            try:
                while data := bob.recv(1 << 16):
                    got += data
            except QuantumSocketError as error:
                assert sent.startswith(got)
                return Outcome(error, bob.statistics)
            assert got == sent
            return Outcome(None, bob.statistics)


def _connection(listener: Any) -> Any:
    """Return bob's connection; None if alice's request has come to nothing before."""
    try:
        return listener.accept()[0]
    except QuantumSocketError as error:
        if error.reason != Reason.NO_LISTENER:
            raise
        return None


class Once:
    """Does something to the first message that fits, and leaves all others alone."""

    def __init__(self, fits: Callable[[str, Message], bool], act: Callable[[Message], Any]) -> None:
        """Keep what becomes of it: a message, bytes as of one, None for none any more."""
        self._fits, self._act = fits, act
        self.done = False

    async def __call__(self, way: str, message: Message) -> Any:
        """Return the message or what it becomes."""
        if self.done or not self._fits(way, message):
            return message
        self.done = True
        become = self._act(message)
        return await become if isinstance(become, Awaitable) else become


@dataclass(frozen=True)
class Raw:
    """Bytes in the place of a message."""

    data: bytes

    def encode(self) -> bytes:
        """Return them."""
        return self.data


class Last(Raw):
    """Bytes after which the connection ends."""

    last = True
