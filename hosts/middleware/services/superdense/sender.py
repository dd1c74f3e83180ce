"""The protocol of superdense coding at the end that sends bytes: no socket, no clock.

    send(data)      the bytes wait in frames
    next_order()    a block is under way: an order for its light
    lit(), dark()   of the first block under way without: the Block that says what its light carried
    heard(report)   of the first block under way: it is not any more

Several blocks are under way at a time: light of the next is made while the receiver measures.
Repetitions are sent when it has reported of all: then both ends know the same, and which blocks
there are does not depend on when a report comes. If there is no light of one, those behind it,
whose frames follow in number, are called off, too.

In the handshake per-pair every pair of an order is asked for by `single` before its light is made.
opener.py carries the messages and has the light made.
"""

from collections import deque
from dataclasses import dataclass, replace
from hashlib import sha256

from hosts.hardware.replies import Symbols
from hosts.middleware.services.superdense.frame_format import (
    BLOCKS_UNDER_WAY,
    FramingError,
    agreed_format,
)
from hosts.middleware.services.superdense.outbox import Outbox, OutgoingBlock
from hosts.middleware.session.encoding import to_paulis
from hosts.middleware.session.errors import SessionError
from hosts.middleware.session.options import MAX_BLOCK_PAIRS
from hosts.timeouts import DARK_LIMIT_S
from wire.metadata.blocks import Block, Report
from wire.metadata.setup import Answer, Setup
from wire.metadata.vocabulary import SYMBOLS, Handshake, Reason
from wire.results.figures import SenderFigures

ATTEMPTS_LIMIT = 64


@dataclass(frozen=True)
class Light:
    """An order: have a block of pairs made, and send this host's halves on by these operators."""

    block: int
    paulis: Symbols  # shape (pairs,)


@dataclass(frozen=True)
class Singles:
    """An order: send symbols, each by a pair that has a handshake of its own."""

    first: int  # number of the first pair; the others follow
    symbols: Symbols  # shape (pairs,)


@dataclass(eq=False)
class _UnderWay:
    """A block whose light has been ordered, and of which the receiver has not reported."""

    block: OutgoingBlock
    announced: bool = False  # the receiver knows its load
    why_dark: str | None = None  # there is no light of it, or there shall be none


def check_frames(setup: Setup) -> None:
    """Raise SessionError for frames that no receiver takes."""
    agreed_format(setup, max(SYMBOLS))


class Sender:
    """Cuts bytes into blocks of symbols, until the receiver has reported that it holds them."""

    def __init__(self, setup: Setup, answer: Answer, peer: str, now_s: float) -> None:
        """Raise SessionError if the receiver does not say what its analyser can do."""
        self._setup, self._encoding, self._peer = setup, answer.encoding, peer
        used = agreed_format(setup, _distinguishable_states(answer))
        self._outbox = Outbox(setup.frame_bytes, setup.pairs, used)
        self._under_way: deque[_UnderWay] = deque()
        self._most_under_way = blocks_under_way(setup)
        self._pairs_begun = 0  # of those with a handshake of their own
        self._lit_at_s = now_s  # when a pair last arrived
        self._digest = sha256()
        self._data = b""  # not held by the receiver yet
        self.statistics = SenderFigures(
            bell_pairs=0,
            lost_pairs=0,
            received_symbols=0,
            symbol_errors=0,
            corrected_symbols=0,
            filled_symbols=0,
            repeated_frames=0,
            delivered_bytes=0,
            rate_hz=setup.rate_hz,
            frame_bytes=setup.frame_bytes,
            fec=setup.fec,
            interleave=setup.interleave,
            wavelength_pm=setup.wavelength_pm,
            code_rate=1.0,
            symbols=answer.symbols,
        )

    @property
    def sent(self) -> tuple[int, bytes]:
        """How many bytes the receiver holds, and their SHA-256."""
        return self.statistics.delivered_bytes, self._digest.digest()

    def send(self, data: bytes) -> None:
        """Take bytes; the receiver holds them once nothing is under way and there is no order."""
        if self._under_way:
            raise ValueError(f"{len(self._under_way)} blocks are under way: hear of them first")
        self._data += data
        self._outbox.add(data)
        self.statistics.code_rate = self._outbox.code_rate

    def next_order(self) -> Light | Singles | None:
        """Return what light to make next.

        None: reports of blocks under way must come first, or the receiver holds every byte.
        """
        if not self._under_way and self._outbox.empty:
            self._note_delivered()
            return None
        if len(self._under_way) >= self._most_under_way:
            return None
        if self._under_way and not self._outbox.goes_ahead:
            return None
        block = self._outbox.next_block()
        self._under_way.append(_UnderWay(block))
        number, symbols = block.number, block.symbols
        self.statistics.bell_pairs += symbols.size
        if self._setup.handshake != Handshake.PER_PAIR:
            return Light(number, to_paulis(symbols, self._encoding))
        first = self._pairs_begun + 1
        self._pairs_begun += symbols.size
        return Singles(first, symbols)

    def single(self, number: int) -> Setup:
        return replace(self._setup, handshake=Handshake.ONE_PAIR, block=number, pairs=1)

    def single_encoding(self, answer: Answer) -> int:
        """Return by which operators the pair is sent that this answers; or raise SessionError."""
        if _distinguishable_states(answer) != self.statistics.symbols:
            before = self.statistics.symbols
            text = f"{self._peer} distinguishes {answer.symbols} Bell states, before {before}"
            raise SessionError(Reason.PROTOCOL, text)
        return answer.encoding

    def lit(self, emitted_ns: int) -> Block:
        first = self._first_unannounced()
        block = first.block
        if first.why_dark is not None:
            raise ValueError(f"block {block.number} is called off: dark() tells the receiver")
        first.announced = True
        pairs = block.symbols.size
        session = self._setup.session
        return Block(session, block.number, pairs, block.refills, emitted_ns, block.frames)

    def dark(self, why: str) -> Block:
        """No light came here: return what tells the receiver to discard its halves."""
        first = self._first_unannounced()
        if first.why_dark is None:
            self._call_off(why)
        first.announced = True
        return Block(self._setup.session, first.block.number, 0, 0, 0)

    def is_called_off(self, number: int) -> bool:
        """Whether a block shall not be sent, because there was no light of one before it."""
        return any(each.block.number == number and each.why_dark for each in self._under_way)

    def heard(self, report: Report, now_s: float) -> None:
        """Note what the receiver says of a block; raise SessionError if it cannot go on so."""
        if not self._under_way or not self._under_way[0].announced:
            raise ValueError("no block waits for a report: lit() or dark() come first")
        first = self._under_way.popleft()
        if first.why_dark is None:
            self._note(first.block, report, now_s)
        else:
            self._give_up_if_dark(first.why_dark, now_s)

    def _first_unannounced(self) -> _UnderWay:
        for each in self._under_way:
            if not each.announced:
                return each
        raise ValueError("no light is being made: next_order() comes first")

    def _call_off(self, why: str) -> None:
        """Take back what has not been announced; the last first, as their frames have numbers."""
        for each in reversed(self._under_way):
            if not each.announced:
                each.why_dark = why
                self._outbox.dark(each.block)
                self.statistics.lost_pairs += each.block.symbols.size

    def _note_delivered(self) -> None:
        self._digest.update(self._data)
        self.statistics.delivered_bytes += len(self._data)
        self._data = b""

    def _note(self, block: OutgoingBlock, report: Report, now_s: float) -> None:
        try:
            self._outbox.report(block, report)
        except FramingError as error:
            raise SessionError(Reason.PROTOCOL, str(error)) from error
        statistics = self.statistics
        statistics.lost_pairs += report.lost
        statistics.received_symbols += report.pairs - report.lost
        statistics.symbol_errors = report.errors
        statistics.corrected_symbols = report.corrected
        statistics.filled_symbols = report.filled
        statistics.repeated_frames = self._outbox.repeated_frames
        if report.lost < report.pairs:
            self._lit_at_s = now_s
        self._give_up_if_dark(f"no pair reached {self._peer}", now_s)
        self._give_up_if_too_noisy()

    def _give_up_if_dark(self, what: str, now_s: float) -> None:
        if now_s - self._lit_at_s > DARK_LIMIT_S:
            raise SessionError(
                Reason.NO_LIGHT,
                f"{what} for {DARK_LIMIT_S:g} s; is a fibre cut, or its loss too high, or do the "
                f"halves of a pair come to {self._peer} further apart than its delay line is long "
                "(analyser.delay_line_km; `qmn spy RUN --kind bell-measure` shows it)?",
            )

    def _give_up_if_too_noisy(self) -> None:
        size = self._setup.frame_bytes
        # A frame of one byte, with half of its four pairs wrong, mostly comes within 64 attempts.
        fewer = "fewer (--frame-bytes; no use if half of the pairs are wrong), " if size > 1 else ""
        for number, attempts in self._outbox.attempts.items():
            if attempts >= ATTEMPTS_LIMIT:
                raise SessionError(
                    Reason.TOO_NOISY,
                    f"frame {number} failed its check {attempts} times: the channel is too noisy "
                    f"for frames of {size} {'bytes' if size > 1 else 'byte'}; choose {fewer}a "
                    "stronger code (--fec) or less noise",
                )


def blocks_under_way(setup: Setup) -> int:
    if setup.handshake == Handshake.PER_PAIR:
        return 1
    return max(1, min(BLOCKS_UNDER_WAY, MAX_BLOCK_PAIRS // setup.pairs))


def _distinguishable_states(answer: Answer) -> int:
    if answer.symbols not in SYMBOLS:
        raise SessionError(Reason.PROTOCOL, "the receiver does not say what its analyser can do")
    return answer.symbols
