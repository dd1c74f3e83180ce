"""The gate: the one process that writes the clock of the network.

    program --(deadline)--> gate --(clock, in a page that all read)--> programs
                                 --(notice)--> the programs whose deadline it is

When nothing runs, the clock leaps to the earliest deadline. Of those that wait for one instant the
first turn is notified at once, and each other when all is quiet again; the background comes last,
before the next leap. While a client asks for that, the clock goes with the wall instead.
"""

import math
import mmap
import os
import select
import socket
import time
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from gate.quiescence import Quiescence
from gate.timeouts import HELD_S, LONGEST_PAUSE_S, PAUSE_S
from wire.leaps import LEAP
from wire.network_time import (
    BACKGROUND,
    GATE,
    INSTANT,
    NEVER,
    PAGE,
    PAGE_BYTES,
    PROGRAMS,
    TAKEN,
    WAIT,
    WATCH,
    WITH_WALL,
)

LISTEN = 1024
NS = 1_000_000_000


@dataclass(eq=False)
class Client:
    """A program, and the instant that it waits for."""

    socket: socket.socket
    deadline_ns: int = NEVER
    background_ns: int = NEVER  # the clock does not leap for it
    turn: int = PROGRAMS
    is_notified: bool = False  # since it has named these

    def is_due(self, now_ns: int, in_background: bool = False) -> bool:
        """Whether it is to be notified, of its deadline or of that in the background."""
        due_ns = self.background_ns if in_background else self.deadline_ns
        return WITH_WALL < due_ns <= now_ns and not self.is_notified


class Gate:
    """The clock, and the programs that wait for it."""

    def __init__(
        self,
        folder: Path,
        since_ns: int,
        leaps: Path,
        quiescence: Quiescence | None = None,
        watched: bool = False,
    ) -> None:
        """Make the page and the socket in the folder; the clock begins at `since_ns`.

        Each leap goes into the file. If people watch, the clock never leads the wall once the
        network is ready.
        """
        self._leaps_file = leaps.open("wb", buffering=0)
        self.leaps = self.wrong = 0  # wrong: a program asked for an instant that had passed
        self._quiet = Quiescence() if quiescence is None else quiescence
        page = os.open(folder / PAGE, os.O_RDWR | os.O_CREAT, 0o600)
        os.ftruncate(page, PAGE_BYTES)
        self._page = mmap.mmap(page, PAGE_BYTES)
        self._clock = memoryview(self._page).cast("q")
        os.close(page)
        self._clock[0] = self._since_ns = since_ns
        self._watched, self._watched_since_s = watched, 0.0
        self._wall_ns = 0  # when the clock was set by the wall last; 0: it does not go with it
        self._stepped_since_ns = since_ns
        self._held_since_s = 0.0  # by the wall; 0: it is not; inf: it was reported
        self._awaited: bool | None = None  # None: clock or clients have changed since
        self._pause_s = PAUSE_S
        self._poller = select.epoll()
        self._clients: dict[int, Client] = {}  # by descriptor
        self._listener = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._listener.bind(str(folder / GATE))
        self._listener.listen(LISTEN)
        self._wake_reader, self._wake_writer = os.pipe()
        self._stopped = False
        for file in (self._listener.fileno(), self._wake_reader):
            self._poller.register(file, select.EPOLLIN)

    @property
    def clock_s(self) -> float:
        """Return how far the clock has gone."""
        return float(self._clock[0] - self._since_ns) / NS

    def stop(self) -> None:
        """Let `run` return; a signal handler may call it."""
        self._stopped = True
        os.write(self._wake_writer, b"\0")

    def run(self) -> None:
        """Step the clock until `stop`."""
        while not self._stopped:
            if self._is_awaited and not self._wall_ns:
                time.sleep(self._pause_s)  # what a client says meanwhile ends no pause
            self._take(self._wait_s())
            if self._wall_ns or self._asks_for_wall:
                self._go_with_wall()
            elif not self._is_awaited:
                self._held_since_s = 0.0
            elif self._is_quiet:
                self._held_since_s = 0.0
                self._go_on()
            else:
                self._pause_s = min(LONGEST_PAUSE_S, 2 * self._pause_s)
                self._tell_what_holds()
        self._leaps_file.close()

    @property
    def _is_quiet(self) -> bool:
        """Whether nothing runs, no message is under way, and no client has written more."""
        return bool(self._quiet) and not self._are_under_way() and not self._take(0)

    def _are_under_way(self) -> bool:
        middle, word = PAGE_BYTES // 2, self._clock.itemsize
        return self._page[word : middle - word] != self._page[middle + word : -word]

    def _tell_what_holds(self) -> None:
        """Say once, after a while, what has not let the clock go on since."""
        now_s = time.monotonic()
        self._held_since_s = self._held_since_s or now_s
        if now_s - self._held_since_s < HELD_S:
            return
        self._held_since_s = math.inf
        links = [
            f"{sent - taken} messages of link {slot // 2}"
            for slot, (sent, taken) in enumerate(
                zip(self._clock[1:BACKGROUND], self._clock[TAKEN + 1 : -1], strict=True)
            )
            if sent != taken
        ]
        what = ", ".join(links) or self._quiet.holder or "nothing that lasts"
        print(f"the clock has stood for {HELD_S:g} s: {what}", flush=True)

    @property
    def _asks_for_wall(self) -> bool:
        return any(client.deadline_ns == WITH_WALL for client in self._clients.values())

    def _due(self, in_background: bool = False) -> list[Client]:
        """Return whom to notify: in the background once the network has been idle."""
        if in_background and not (self._wall_ns or self._clock[TAKEN]):
            return []
        now_ns = self._clock[0]
        return [client for client in self._clients.values() if client.is_due(now_ns, in_background)]

    @property
    def _next_ns(self) -> int:
        clients = self._clients.values()
        awaited = (client.deadline_ns for client in clients if client.turn != WATCH)
        if (awaited_ns := min(awaited, default=NEVER)) == NEVER:
            return NEVER
        return min(awaited_ns, *(client.deadline_ns for client in clients))

    @property
    def _is_next(self) -> bool:
        return bool(self._clock[0] < self._next_ns < NEVER)

    @property
    def _is_awaited(self) -> bool:
        """Whether one waits for the end of this instant, or all for an instant to come."""
        if self._awaited is None:
            due = self._clock[BACKGROUND] or self._due() or self._due(in_background=True)
            self._awaited = bool(due) or self._is_next
        return self._awaited

    def _go_on(self) -> None:
        """Leap if nobody waits for this instant, and notify those whose turn is the first."""
        due, self._clock[BACKGROUND], self._awaited = self._due(), 0, None
        if not due and (background := self._due(in_background=True)):
            self._clock[BACKGROUND], self._pause_s = 1, PAUSE_S
            self._notify(background, in_background=True)
            return
        if not (due or self._is_next):
            return
        if not due and self._watched and (early_s := self._early_s()) > 0:
            self._poller.poll(early_s)
            return
        if not due:
            self._leaps_file.write(LEAP.pack(time.time_ns(), self._next_ns))
            self._clock[0] = self._next_ns
            self.leaps += 1
            due = self._due()
        self._pause_s = PAUSE_S
        turn = min(client.turn for client in due)
        self._notify(client for client in due if client.turn == turn)

    def _early_s(self) -> float:
        """Return by how much the next leap would lead the wall."""
        if (begun_ns := self._clock[TAKEN]) <= 0:
            return 0.0
        now_s = time.monotonic()
        self._watched_since_s = self._watched_since_s or now_s
        return float(self._next_ns - begun_ns) / NS - (now_s - self._watched_since_s)

    def _wait_s(self) -> float | None:
        """Return how long to wait for clients at most; None: until one says something."""
        if self._wall_ns:
            now_ns = self._clock[0]
            to_come = [
                each
                for client in self._clients.values()
                for each in (client.deadline_ns, client.background_ns)
                if now_ns < each < NEVER
            ]
            return (min(to_come) - now_ns) / NS if to_come else None
        return 0 if self._is_awaited else None

    def _take(self, wait_s: float | None) -> bool:
        """Take what clients say; return whether one did."""
        events = self._poller.poll(wait_s)
        for file, _event in events:
            if file == self._listener.fileno():
                client = self._listener.accept()[0]
                self._clients[client.fileno()] = Client(client)
                self._poller.register(client, select.EPOLLIN)
            elif file in self._clients:
                self._hear(self._clients[file])
        return bool(events)

    def _hear(self, client: Client) -> None:
        try:
            message = client.socket.recv(WAIT.size)
        except ConnectionError:
            message = b""
        if not message:
            self._poller.unregister(client.socket)
            del self._clients[client.socket.fileno()]
            self._awaited = None
            client.socket.close()
            return
        client.deadline_ns, client.background_ns, client.turn = WAIT.unpack(message)
        client.is_notified = False
        self._awaited = None
        now_ns = self._clock[0]
        self.wrong += self._stepped_since_ns < client.deadline_ns < now_ns
        if self._wall_ns and client.is_due(now_ns, in_background=True):
            self._notify([client], in_background=True)
        elif client.is_due(now_ns) and (client.turn <= PROGRAMS or self._wall_ns):
            self._notify([client])

    def _go_with_wall(self) -> None:
        """Set the clock by the wall, as long as a client asks for it."""
        wall_ns = time.monotonic_ns()
        if self._wall_ns:
            self._clock[0] += wall_ns - self._wall_ns
        self._wall_ns = wall_ns if self._asks_for_wall else 0
        self._stepped_since_ns = self._clock[0]
        self._clock[BACKGROUND] = 0
        for in_background in (False, True):
            self._notify(self._due(in_background), in_background)

    def _notify(self, clients: Iterable[Client], in_background: bool = False) -> None:
        self._awaited = None
        for client in clients:
            client.is_notified = True
            with suppress(ConnectionError):  # it has ended, which is read next
                client.socket.send(INSTANT.pack(self._clock[0], in_background))
