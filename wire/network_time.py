"""Time of the network: paced by the wall clock, or stepped while no program runs.

Paced, one second of the network takes `scale` seconds here.

          network   0        1        2        3
    scale 1         |--------|--------|--------|
    scale 2         |-----------------|-----------------|----  wall

Stepped, the clock stands while programs run, and leaps to the next instant that one waits for
(gate/). Physics, and every time-out of a protocol, counts network time. Captures and logs
carry the wall clock. Each process has one of these from its configuration.
"""

import mmap
import socket
import struct
import time
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

LEAST_SCALE, MOST_SCALE = 1.0, 1e9
PAGE, GATE = "page", "gate"  # in the folder of stepped time: its clock, and the gate's socket
INSTANT = struct.Struct("=q?")  # a notice of the gate: its clock (ns), whether of the background
WAIT = struct.Struct("=qqb")  # of a client: its deadline, that in the background, its turn
PAGE_BYTES = 1 << 16
# The page has the clock, counts of messages sent, when stepping began, counts of those taken; the
# last of those sent says whether what waits in the background is done now.
TAKEN = PAGE_BYTES // 16
BACKGROUND = TAKEN - 1
NEVER = (1 << 63) - 1  # the deadline of a program that waits for no instant
SETTLING = -1  # in place of the instant at which stepping began
WITH_WALL = -1  # in place of a deadline: the clock is to go with the wall
# Whose turn it is first if several wait for one instant; those behind wait until all is quiet.
# The clock does not leap for the last: it stops there, on its way to what others wait for.
CABLES, PROGRAMS, DISPATCHER, CONTROLLER, TICKS, WATCH = range(6)


@dataclass(frozen=True)
class NetworkTime:
    """The relation of both clocks, which agree at `since_ns` (nanoseconds since 1970).

    Raise ValueError for a scale out of range.
    """

    scale: float = 1.0
    since_ns: int = 0

    def __post_init__(self) -> None:
        # Faster than the wall would make software a larger part of time, and not a smaller one.
        if not LEAST_SCALE <= self.scale <= MOST_SCALE:
            raise ValueError(
                f"time scale {self.scale:g}: choose {LEAST_SCALE:g} to {MOST_SCALE:g} seconds here "
                "for one second of the network"
            )

    def now_ns(self) -> int:
        """Return the time of the network in nanoseconds since 1970."""
        return self.network_ns(time.time_ns())

    def now_s(self) -> float:
        """Return the time of the network in seconds, to measure by."""
        return self.network_s(time.monotonic())

    def stamp_ns(self) -> int:
        """Return what events and records are stamped with: the wall clock, as captures are."""
        return time.time_ns()

    @property
    def has_begun(self) -> bool:
        """Whether the network is ready, which only stepped time knows."""
        return True

    def background_s(self) -> float:
        """Return the seconds by which discovery, polls and reports go: those of the wall."""
        return time.monotonic()

    def switch_timeout_s(self, seconds: int) -> int:
        """Return the idle time-out of an entry that Open vSwitch counts by the wall; 0: never."""
        return seconds

    def network_ns(self, wall_ns: int) -> int:
        if self.scale == 1:
            return wall_ns
        return self.since_ns + round((wall_ns - self.since_ns) / self.scale)

    def wall_ns(self, network_ns: int) -> int:
        if self.scale == 1:
            return network_ns
        return self.since_ns + round((network_ns - self.since_ns) * self.scale)

    def network_s(self, wall_s: float) -> float:
        """Return how much time of the network passes in a time here."""
        return wall_s / self.scale

    def wall_s(self, network_s: float) -> float:
        """Return how long a time of the network takes here."""
        return network_s * self.scale


@dataclass(frozen=True)
class SteppedTime(NetworkTime):
    """Time that the gate steps; the clock is in a page of memory that all programs read.

    Its seconds are not those of the wall: what is converted between both stays as it is.
    """

    folder: str = ""
    slot: int = 0  # of this program's link

    # Each object has its own: a later network may have the same folder.
    @cached_property
    def clock(self) -> memoryview:
        """The page whose first number is the clock; hosts can read it, and not write."""
        with (Path(self.folder) / PAGE).open("rb") as file:
            mapped = mmap.mmap(file.fileno(), PAGE_BYTES, access=mmap.ACCESS_READ)
        return memoryview(mapped).cast("q")

    @cached_property
    def page(self) -> memoryview:
        """The memory that all programs share: the clock, and the counts of links."""
        with (Path(self.folder) / PAGE).open("r+b") as file:
            return memoryview(mmap.mmap(file.fileno(), PAGE_BYTES)).cast("q")

    def now_ns(self) -> int:
        """Return the time of the network in nanoseconds since 1970, at the start of the run."""
        return int(self.clock[0])

    def now_s(self) -> float:
        """Return the seconds of the network since the run began, exact to the nanosecond."""
        return (self.now_ns() - self.since_ns) / 1e9

    def stamp_ns(self) -> int:
        return self.now_ns()

    @property
    def has_begun(self) -> bool:
        """Whether the network is ready, and steps."""
        return int(self.page[TAKEN]) > 0

    @property
    def in_background(self) -> bool:
        """Whether nothing but what waits in the background runs."""
        return bool(self.page[BACKGROUND])

    def settle(self) -> None:
        """Let the background go on, before the network is ready."""
        self.page[TAKEN] = SETTLING

    def begin(self) -> None:
        """Note that the network is ready."""
        self.page[TAKEN] = self.now_ns()

    def background_s(self) -> float:
        """Return the seconds of the network: what goes by the wall comes at any instant."""
        return self.now_s()

    def switch_timeout_s(self, seconds: int) -> int:
        """Return 0: what takes its place could need the time that waits for it."""
        return 0


class LinkCounts:
    """Counts of messages on a link that no cable delays: time stands while one is under way.

    Their carrier, such as gRPC, may rest for milliseconds of the wall while nothing runs.
    """

    def __init__(self, time: NetworkTime, far_slot: int | None = None) -> None:
        """Count at this program's end, or at the far one of the program that has a slot.

        As a program begins nothing is under way: one before it may have been killed.
        """
        self._page: memoryview | None = None
        slot, far = 0, far_slot is not None
        if isinstance(time, SteppedTime):
            self._page = time.page
            slot = time.slot if far_slot is None else far_slot
        self._sent = 1 + 2 * slot + far
        self._taken = TAKEN + 1 + 2 * slot + (not far)
        if not far:
            self.answered_all()
            self.ended()

    def sent(self) -> None:
        """Count a message, before it is sent."""
        if self._page is not None:
            self._page[self._sent] += 1

    def taken(self) -> None:
        """Count a message that has come."""
        if self._page is not None:
            self._page[self._taken] += 1

    def answered(self) -> None:
        """Count a message as taken whose answer has come: the far end does not count it."""
        if self._page is not None:
            self._page[self._sent + TAKEN] += 1

    def answered_all(self) -> None:
        """Count all that this end has sent as taken."""
        if self._page is not None:
            self._page[self._sent + TAKEN] = self._page[self._sent]

    def ended(self) -> None:
        """Count all that the other end has sent as taken: no more will come."""
        if self._page is not None:
            self._page[self._taken] = self._page[self._taken - TAKEN]


class GateClient:
    """This program's connection to the gate: the next instant that it waits for.

    The clock cannot leap beyond that instant before the program has named a later one.
    """

    def __init__(self, time: SteppedTime, turn: int = PROGRAMS) -> None:
        """Connect; raise OSError if there is no gate."""
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._socket.connect(f"{time.folder}/{GATE}")
        self._turn = turn
        self._deadlines: tuple[int, ...] = (NEVER, NEVER)  # none: the gate waits for the next

    def fileno(self) -> int:
        """Return the descriptor that is readable once the clock has reached the deadline."""
        return self._socket.fileno()

    def wait_for(self, deadline_ns: int, background_ns: int = NEVER) -> None:
        """Set the deadline: an instant, NEVER, or WITH_WALL.

        The clock does not leap to the deadline in the background: it is due once the clock has
        passed it, and all else of the instant is done. A program whose turn is behind PROGRAMS may
        name this instant: it is notified at its end, when all else is quiet.
        """
        deadlines = deadline_ns, background_ns
        if deadlines != self._deadlines:
            self._deadlines = deadlines
            self._socket.send(WAIT.pack(deadline_ns, background_ns, self._turn))

    def take_notice(self) -> bool:
        """Return whether the gate's notice is of the background; raise EOFError if it has ended."""
        if not (notice := self._socket.recv(INSTANT.size)):
            raise EOFError("the gate of the network's time has ended")
        self._deadlines = ()
        return bool(INSTANT.unpack(notice)[1])

    def close(self) -> None:
        """Disconnect: the clock does not wait for this program any more."""
        self._socket.close()


REAL_TIME = NetworkTime()  # one second of the network takes one here
