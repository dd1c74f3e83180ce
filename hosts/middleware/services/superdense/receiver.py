"""The protocol of superdense coding at the end that receives bytes: no socket, no clock.

    WAITING    block(message)    an order: what to measure, to collect or to discard -> MEASURING
    MEASURING  arrived(symbols)  the bytes that are whole now, and a Report -> WAITING
    WAITING    finish(message)   all bytes are here and right

`read` makes symbols of the outcomes of a measurement. In the handshake per-pair `join` answers the
set-up of each pair and orders its measurement, at any time; the order for a block then collects
what has been read. acceptor.py carries the messages and measures.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum, auto
from hashlib import sha256

import numpy as np

from hosts.hardware.replies import Symbols
from hosts.middleware.services.superdense.frame_format import (
    ALPHABETS,
    FrameFormat,
    FramingError,
    agreed_format,
)
from hosts.middleware.services.superdense.inbox import Inbox
from hosts.middleware.session.encoding import agreed_encoding, from_bell_states
from hosts.middleware.session.errors import SessionError, unsupported
from hosts.middleware.session.offers import check_light, offer_nothing_but_0
from hosts.middleware.session.options import MAX_BLOCK_PAIRS, MAX_FRAME_BYTES
from wire.metadata.blocks import Block, Finish, Report
from wire.metadata.setup import Answer, Setup
from wire.metadata.vocabulary import Handshake, Reason
from wire.outcomes import NO_COINCIDENCE
from wire.results.figures import ReceiverFigures


@dataclass(frozen=True)
class Measure:
    """An order: Bell-measure the two halves of a block."""

    block: int
    pairs: int
    rotation: int  # of the light paths, as the controller knows it


@dataclass(frozen=True)
class Discard:
    """An order: discard the halves of a block of which the others will not come."""

    block: int


@dataclass(frozen=True)
class Collect:
    """An order: put together the symbols of pairs that have had handshakes of their own."""

    numbers: range


class State(Enum):
    WAITING = auto()
    MEASURING = auto()


def check_offer(setup: Setup, symbols: int) -> FrameFormat:
    """Return what frames are made of; raise SessionError for a set-up that cannot be served."""
    check_light(setup)
    offer_nothing_but_0({"fidelity at least": setup.fidelity_ppm})
    if setup.frame_bytes > MAX_FRAME_BYTES or setup.pairs > MAX_BLOCK_PAIRS:
        raise unsupported(
            f"frames of {setup.frame_bytes} bytes in blocks of {setup.pairs} pairs; at most "
            f"{MAX_FRAME_BYTES} and {MAX_BLOCK_PAIRS}",
        )
    if symbols not in ALPHABETS:
        text = f"an analyser that distinguishes {symbols} Bell states: choose another analyser.kind"
        raise unsupported(text)
    return agreed_format(setup, symbols)


def answer_to(setup: Setup, symbols: int, rotation: int) -> Answer:
    """Return the acceptance of a set-up: number of distinguishable Bell states, and operators."""
    encoding = agreed_encoding(setup.encoding, symbols, rotation)
    return Answer(setup.session, Reason.OK, symbols=symbols, encoding=encoding)


class Receiver:
    """Turns Bell states into bytes, and says what must come again."""

    def __init__(self, setup: Setup, symbols: int, peer: str) -> None:
        self._setup, self._symbols, self._peer = setup, symbols, peer
        self._format = agreed_format(setup, symbols)
        self._inbox = Inbox(setup.frame_bytes, self._format)
        self._state = State.WAITING
        self._block: Block | None = None  # whose light is being measured
        self._singles: set[int] = set()  # pairs that were asked for, and not collected yet
        self._singles_used = 0
        self._digest = sha256()
        self._size = 0

    @property
    def statistics(self) -> ReceiverFigures:
        """Counts for the application and for diagnosis.

        `confusion` has a row for each symbol sent and a column for each received, of the frames
        that have arrived: before their check is right, nobody here knows what was sent.
        """
        return ReceiverFigures(
            bytes=self._size,
            symbols=self._inbox.symbols_seen,
            lost_pairs=self._inbox.symbols_lost,
            symbol_errors=self._inbox.symbol_errors,
            corrected_symbols=self._inbox.corrected_symbols,
            filled_symbols=self._inbox.filled_symbols,
            repeated_frames=self._inbox.repeated_frames,
            confusion=self._inbox.confusion.tolist(),
        )

    def counts(self) -> Mapping[str, int]:
        return {
            "pairs_received": self._inbox.symbols_seen,
            "pairs_lost": self._inbox.symbols_lost,
            "symbol_errors": self._inbox.symbol_errors,
            "repeated_frames": self._inbox.repeated_frames,
        }

    def block(self, block: Block) -> Measure | Discard | Collect:
        """Return what to do for a block of which the sender says what it carries."""
        self._require(State.WAITING)
        longest_frame = self._format.pairs(self._setup.frame_bytes)
        if block.pairs > max(self._setup.pairs, longest_frame):
            raise SessionError(Reason.PROTOCOL, f"block {block.block} has {block.pairs} pairs")
        self._block, self._state = block, State.MEASURING
        if block.pairs == 0:  # no light reached the sender
            return Discard(block.block)
        if self._setup.handshake == Handshake.PER_PAIR:
            return self._collect(block.pairs)
        return Measure(block.block, block.pairs, self._setup.rotation)

    def read(self, order: Measure, outcomes: Symbols | None) -> Symbols:
        """Return the symbols of what was measured; None: a half did not come, all are lost."""
        if outcomes is None:
            outcomes = np.full(order.pairs, NO_COINCIDENCE, dtype=np.uint8)
        if outcomes.size != order.pairs:
            text = f"block {order.block}: {outcomes.size} pairs of light"
            raise SessionError(Reason.PROTOCOL, text)
        encoding = agreed_encoding(self._setup.encoding, self._symbols, order.rotation)
        return from_bell_states(outcomes, encoding, order.rotation, self._symbols)

    def arrived(self, symbols: Symbols) -> tuple[bytes, Report]:
        """Take the symbols of a block; return bytes that are whole now, and what to report."""
        self._require(State.MEASURING)
        assert self._block is not None
        self._state = State.WAITING
        try:
            report = self._inbox.block(self._block, symbols)
        except FramingError as error:
            raise SessionError(Reason.PROTOCOL, str(error)) from error
        data = self._inbox.take()
        self._digest.update(data)
        self._size += len(data)
        return data, report

    def join(self, setup: Setup, peer: str) -> tuple[Answer, Measure]:
        """Return what accepts the handshake of a pair, and what to do once its light is over."""
        if peer != self._peer:
            text = f"pair {setup.block} of a session of {self._peer} from {peer}"
            raise SessionError(Reason.UNKNOWN_SESSION, text)
        used = setup.block in self._singles or setup.block <= self._singles_used
        if self._setup.handshake != Handshake.PER_PAIR or used:
            text = f"pair {setup.block} is not expected (any more): is its set-up a replay?"
            raise SessionError(Reason.PROTOCOL, text)
        if len(self._singles) >= MAX_BLOCK_PAIRS:
            raise SessionError(Reason.PROTOCOL, "too many pairs without a block message")
        self._singles.add(setup.block)
        answer = answer_to(self._setup, self._symbols, setup.rotation)
        return answer, Measure(setup.block, 1, setup.rotation)

    def finish(self, finish: Finish) -> None:
        """Raise SessionError if what has come is not what was sent."""
        self._require(State.WAITING)
        if (finish.size, finish.sha256) != (self._size, self._digest.digest()):
            raise SessionError(
                Reason.WRONG_DIGEST,
                f"{self._size} of {finish.size} bytes arrived, or their SHA-256 differs",
            )

    def _collect(self, pairs: int) -> Collect:
        numbers = range(self._singles_used + 1, self._singles_used + pairs + 1)
        self._singles_used += pairs
        unknown = [number for number in numbers if number not in self._singles]
        if unknown:
            raise SessionError(Reason.PROTOCOL, f"pair {unknown[0]} had no handshake")
        self._singles.difference_update(numbers)
        return Collect(numbers)

    def _require(self, state: State) -> None:
        if self._state is not state:
            raise ValueError(f"{self._state.name.lower()}, not {state.name.lower()}: await that")
