"""The place of every block: at a node, waiting at one of its ports, or on its way.

How often the name of a block has been used: random numbers are keyed by name.

A block that is created under a name that was used before, and is free again, must not draw what
the other one has drawn. Numbers of a session mostly follow one another: they are kept as ranges.
"""

from bisect import bisect_right
from collections import deque
from collections.abc import Callable, Collection
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dispatcher.approximations import EXACT, Approximations
from dispatcher.devices.overlap import Spectrum
from dispatcher.fiber.turn import Turn
from dispatcher.layer.emitted_light import Makers
from dispatcher.layer.weak_pulses import WeakPulses
from dispatcher.refusal import denied
from dispatcher.sabot.registers import Register
from wire.parameters.physics import ENCODINGS

MOST_SESSIONS = 65_536  # remembered; their numbers are drawn at random, and never come again
MOST_RANGES = 4_096  # of a session; beyond, all up to the largest count as used
MOST_REPEATED = 65_536  # numbers of a session whose uses are counted


class UsedNumbers:
    def __init__(self) -> None:
        self._begins: list[int] = []
        self._ends: list[int] = []  # of ranges; the last number and one more
        self._repeated: dict[int, int] = {}
        self._round = 0  # how often these were forgotten

    def use(self, number: int) -> str:
        """Note one more use of a number; return what tells it from earlier ones, first empty."""
        at = bisect_right(self._begins, number) - 1
        if at < 0 or number >= self._ends[at]:
            self._add(number, at)
            return ""
        if len(self._repeated) == MOST_REPEATED and number not in self._repeated:
            self._repeated.clear()
            self._round += 1
        self._repeated[number] = self._repeated.get(number, 0) + 1
        return f"again {self._round} {self._repeated[number]}"

    def _add(self, number: int, at: int) -> None:
        begins, ends = self._begins, self._ends
        if at >= 0 and ends[at] == number:
            ends[at] += 1
        else:
            at += 1
            begins.insert(at, number)
            ends.insert(at, number + 1)
        if at + 1 < len(begins) and begins[at + 1] == ends[at]:
            ends[at] = ends.pop(at + 1)
            del begins[at + 1]
        if len(begins) > MOST_RANGES:
            begins[:], ends[:] = [0], [ends[-1]]


class UsedNames:
    def __init__(self) -> None:
        self._sessions: dict[int, UsedNumbers] = {}

    def use(self, session: int, number: int) -> str:
        """Note that blocks of this name are created; return what tells them from earlier ones."""
        if session not in self._sessions:
            if len(self._sessions) == MOST_SESSIONS:
                del self._sessions[next(iter(self._sessions))]
            self._sessions[session] = UsedNumbers()
        return self._sessions[session].use(number)


HALVES = (0, 1)
MAX_BLOCKS = 100_000  # of all nodes: one takes 1 to 7 kB beside its qubits
CLOSED_SESSIONS = 256  # remembered, for the light that is on its way when they end


class BlockName(NamedTuple):
    """Names the photons of one half of a session's block."""

    session: int
    number: int
    half: int

    def __str__(self) -> str:
        return f"block {self.number}/{self.half} of session {self.session:016x}"


@dataclass(slots=True)
class Pulses:
    """The light of k photons besides their quantum state; None: nothing to note.

    Arrays have shape (k,) and cover the whole block, whichever part of it is here.
    """

    extras: NDArray[np.uint8] | None = None  # photons in a pulse that are noise, without a state
    delays_ps: NDArray[np.float64] | None = None  # later than the block's rate says
    angles_rad: NDArray[np.float64] | None = None  # coherent rotation about Z so far
    turn: Turn | None = None  # coherent rotation about any axis so far
    polarization: Turn | None = None  # how it was turned, of light whose qubits are not in it
    encoding: str = ENCODINGS[0]
    bandwidth_nm: float = 0.0  # rms of the source's spectrum
    dispersion_ps_per_nm: float = 0.0  # of all fibres so far
    frequency_mhz: int = 0  # with which it was launched last; 0: never
    approximations: Approximations = EXACT  # so far

    @property
    def spectrum(self) -> Spectrum:
        return Spectrum(self.bandwidth_nm, self.dispersion_ps_per_nm, self.frequency_mhz)

    @property
    def exact(self) -> bool:
        return not self.approximations


@dataclass(eq=False, slots=True)
class ExtraPairs:
    """Photons of further pairs in pulses, each a qubit: m of them, those elsewhere included."""

    register: Register
    pulses: NDArray[np.int64]  # the pulse of each, shape (m,), ascending

    @property
    def present_pulses(self) -> NDArray[np.int64]:
        """Return the pulses of those that are there, ascending."""
        return self.pulses.compress(self.register.present)  # faster than by a mask


@dataclass(eq=False, slots=True)
class Block:
    """Photons of a block that are together; one block may have parts at several nodes."""

    name: BlockName
    register: Register
    node: str  # empty: on its way
    port: str = ""  # where it waits to be received
    first_ns: int = 0  # first and last photon at the port
    last_ns: int = 0
    fibers_passed: int = 0
    pulses: Pulses = field(default_factory=Pulses)
    extra_pairs: ExtraPairs | None = None  # None: no pulse has a photon of a second pair
    weak: WeakPulses | None = None  # instead of all these, of a register without a place
    start_ns: int = 0  # when photon 0 is, or would have been, at the port; photon k comes later
    interval_ns: float = 0.0  # by k times this; 0: they were in no fibre yet
    came_ns: NDArray[np.int64] | None = None  # when each began to be, instead; shape (k,)
    path_ps: float = 0.0  # how long its light was in fibres since its source, or a memory, sent it
    retimed: bool = False  # a memory, or a host that has prepared it, sends it when it is wanted
    source_rate_hz: float = float("inf")  # at most, while they have not left their source
    stored_ns: int = 0  # when the block was put into memory last
    stores: int = 0  # how often that was
    resends: int = 0  # how often photons were measured and replaced by others
    gates: int = 0  # how many gates were done to it whose noise was drawn
    cutoff_s: float = float("inf")  # of the memory: what is older is dropped
    kept: bool = (
        False  # qubits of the node, not light: they have been in its memory, or were made there
    )
    born_ns: NDArray[np.int64] | None = None  # when each came, if it has been looked at; shape (k,)
    false_heralds: NDArray[np.bool_] | None = None  # empty places that a memory says are full
    # Distinguishes these photons from others of this name: its use, or their origin.
    lineage: str = ""
    maker: str = ""  # the node that has made it; the first at which it is, by default
    heard_ns: int = 0  # when its node can hear of it, if it was heralded elsewhere
    waited_ns: int = 0  # in the memory of a switch that has sent it last; on average

    @property
    def size(self) -> int:
        """How many pulses, or qubits, it has a place for."""
        return self.register.size if self.weak is None else self.weak.count

    @property
    def places(self) -> int:
        """How much of its node's share of photons it takes."""
        return self.register.size if self.weak is None else self.weak.places

    @property
    def remaining(self) -> int:
        """In how many of them a photon is left; of weak pulses the photons, on average."""
        return self.register.remaining if self.weak is None else self.weak.expected

    @property
    def is_new(self) -> bool:
        """Whether it is light that has been nowhere since it was made, nor its other half."""
        return not (self.fibers_passed or self.interval_ns or self.kept or self.came_ns is not None)

    def draws_for(self, purpose: str) -> str:
        return f"{self.lineage} {purpose}" if self.lineage else purpose


class Ownership:
    """All live blocks, found by name or by node and session.

    A node does not find light that an event elsewhere has made here before news of it can have
    come.
    """

    def __init__(self, now_ns: Callable[[], int], news_ns: Callable[[str, str], int]) -> None:
        """Begin with none, this clock, and how long news takes from a place to a node."""
        self._now_ns = now_ns
        self._unheard_of: list[Block] = []
        self._by_name: dict[BlockName, list[Block]] = {}
        self._by_session: dict[tuple[str, int], dict[Block, None]] = {}
        self._closed: deque[tuple[str, int]] = deque(maxlen=CLOSED_SESSIONS)
        self.used_names = UsedNames()
        self.count = 0
        self.places = 0  # for photons in all blocks, those that are lost included
        self.makers = Makers(now_ns, news_ns)

    def close(self, node: str, session: int) -> None:
        if (node, session) not in self._closed:
            self._closed.append((node, session))

    def is_closed(self, node: str, session: int) -> bool:
        return (node, session) in self._closed

    def add_when_heard(self, block: Block) -> None:
        """Enter a new block where it says it is, once its node can have heard of it."""
        self._unheard_of.append(block)

    def _hear(self) -> None:
        """Enter the blocks that their nodes can have heard of by now."""
        if not self._unheard_of:
            return
        now_ns, waiting = self._now_ns(), self._unheard_of
        self._unheard_of = [block for block in waiting if block.heard_ns > now_ns]
        for block in waiting:
            if block.heard_ns <= now_ns:
                self.add(block)

    def add(self, block: Block) -> None:
        self._by_name.setdefault(block.name, []).append(block)
        self._by_session.setdefault((block.node, block.name.session), {})[block] = None
        self.count += 1
        self.places += block.places
        block.maker = block.maker or block.node
        self.makers.add(block.maker, block.name, block.places)

    def change(self, block: Block, register: Register, weak: WeakPulses | None = None) -> None:
        before = block.places
        block.register, block.weak = register, weak
        more = block.places - before
        self.places += more
        self.makers.grow(block.maker, block.name, more)

    def remove(self, block: Block) -> None:
        self.makers.end(block.maker, block.name, block.node)
        parts = self._by_name[block.name]
        parts.remove(block)
        if not parts:
            del self._by_name[block.name]
        self._leave(block)
        self.count -= 1
        self.places -= block.places

    def move(self, block: Block, node: str, port: str = "") -> None:
        self._leave(block)
        block.node, block.port = node, port
        self._by_session.setdefault((node, block.name.session), {})[block] = None

    def taken(self, name: BlockName, node: str, leaving: Collection[Block] = ()) -> bool:
        """Return whether a node cannot make photons of this name: it has some, or has made some.

        Those that leave it just now do not count, nor do those of others elsewhere: nobody keeps a
        name from its owner.
        """
        self._hear()
        here = [part for part in self._by_name.get(name, ()) if part.node == node]
        parts_here = sum(part in leaving and part.maker == node for part in here)
        return (
            any(part not in leaving for part in here) or self.makers.parts(node, name) > parts_here
        )

    def parts(self, name: BlockName) -> list[Block]:
        self._hear()
        return list(self._by_name.get(name, ()))

    def rest_flies(self, block: Block) -> bool:
        """Return whether other parts of a block are in fibres, from where they may join it."""
        parts = self._by_name[block.name]
        return len(parts) > 1 and any(not p.node and p.maker == block.maker for p in parts)

    def at(self, name: BlockName, node: str, port: str = "") -> Block | None:
        self._hear()
        for block in self._by_name.get(name, ()):
            if (block.node, block.port) == (node, port):
                return block
        return None

    def require(self, name: BlockName, node: str) -> Block:
        """Return the block of this name at the node, or refuse with the reason.

        No answer depends on whether it is elsewhere, or nowhere any more: that would be news.
        """
        block = self.at(name, node)
        if block is not None:
            return block
        waiting = [part.port for part in self.parts(name) if part.node == node]
        if waiting:
            raise denied(f"{name} waits at port {waiting[0]} of {node}; receive it first")
        raise denied(f"{name} is not at {node}; create or receive it first")

    def of_session(self, node: str, session: int) -> list[Block]:
        """Return all blocks of a session at a node, those at its ports included."""
        self._hear()
        return list(self._by_session.get((node, session), ()))

    def at_node(self, node: str) -> list[Block]:
        """Return all blocks at a node, those at its ports included; none at no node."""
        self._hear()
        if not node:
            return []
        places = [place for place in self._by_session if place[0] == node]
        return [block for place in places for block in self._by_session[place]]

    def _leave(self, block: Block) -> None:
        place = (block.node, block.name.session)
        del self._by_session[place][block]
        if not self._by_session[place]:
            del self._by_session[place]
