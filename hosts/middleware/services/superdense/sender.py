"""The protocol of superdense coding at the end that sends bytes: no socket, no clock.

    IDLE       send(data)      the bytes wait in frames
    IDLE       next_order()    an order for light -> EMITTING; None: the receiver holds all
    EMITTING   lit(), dark()   the Block that says what the light has carried -> REPORTING
    REPORTING  heard(report)   -> IDLE

In the handshake per-pair every pair of an order is asked for by `single` before its light is made.
opener.py carries the messages and has the light made.
"""

from dataclasses import dataclass, replace
from enum import Enum, auto
from hashlib import sha256

from hosts.hardware.qnic import Symbols
from hosts.middleware.services.superdense.frame_format import agreed_format
from hosts.middleware.services.superdense.framing import FramingError
from hosts.middleware.services.superdense.outbox import Outbox, OutgoingBlock
from hosts.middleware.session.channel import SessionError
from hosts.middleware.session.encoding import to_paulis
from hosts.timeouts import DARK_LIMIT_S
from wire.metadata import SYMBOLS, Answer, Block, Handshake, Reason, Report, Setup

ATTEMPTS_LIMIT = 64


@dataclass
class Statistics:
    """What a session has used so far."""

    bell_pairs: int = 0
    lost_pairs: int = 0
    received_symbols: int = 0
    symbol_errors: int = 0
    corrected_symbols: int = 0  # those of the wrong ones that the code has put right
    filled_symbols: int = 0  # lost ones that the code has filled in
    repeated_frames: int = 0
    delivered_bytes: int = 0
    rate_hz: int = 0  # what the session uses; the controller may have overridden it
    frame_bytes: int = 0
    fec: int = 0
    interleave: int = 0
    wavelength_pm: int = 0
    code_rate: float = 1.0  # bits of data for each bit of code, in all frames so far
    symbols: int = 0  # Bell states that the receiver's analyser tells apart; 0: not known yet


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


class State(Enum):
    """What a sender waits for."""

    IDLE = auto()
    EMITTING = auto()
    REPORTING = auto()


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
        self._state = State.IDLE
        self._block: OutgoingBlock | None = None  # under way
        self._why_dark: str | None = None  # of the block under way
        self._pairs_begun = 0  # of those with a handshake of their own
        self._lit_at_s = now_s  # when a pair last arrived
        self._digest = sha256()
        self._data = b""  # not held by the receiver yet
        used_of = "rate_hz", "frame_bytes", "fec", "interleave", "wavelength_pm"
        self.statistics = Statistics(
            symbols=answer.symbols, **{name: getattr(setup, name) for name in used_of}
        )

    @property
    def sent(self) -> tuple[int, bytes]:
        """How many bytes the receiver holds, and their SHA-256."""
        return self.statistics.delivered_bytes, self._digest.digest()

    def send(self, data: bytes) -> None:
        """Take bytes; the receiver holds them once there is no further order."""
        self._require(State.IDLE)
        self._data += data
        self._outbox.add(data)
        self.statistics.code_rate = self._outbox.code_rate

    def next_order(self) -> Light | Singles | None:
        """Return what light to make next; None once the receiver holds every byte."""
        self._require(State.IDLE)
        if self._outbox.empty:
            self._note_delivered()
            return None
        self._block, self._why_dark = self._outbox.next_block(), None
        self._state = State.EMITTING
        number, symbols = self._block.number, self._block.symbols
        self.statistics.bell_pairs += symbols.size
        if self._setup.handshake != Handshake.PER_PAIR:
            return Light(number, to_paulis(symbols, self._encoding))
        first = self._pairs_begun + 1
        self._pairs_begun += symbols.size
        return Singles(first, symbols)

    def single(self, number: int) -> Setup:
        """Return what asks for one pair."""
        return replace(self._setup, handshake=Handshake.ONE_PAIR, block=number, pairs=1)

    def single_encoding(self, answer: Answer) -> int:
        """Return by which operators the pair is sent that this answers; or raise SessionError."""
        if _distinguishable_states(answer) != self.statistics.symbols:
            text = f"{self._peer} tells {answer.symbols} Bell states apart, and did not"
            raise SessionError(Reason.PROTOCOL, text)
        return answer.encoding

    def lit(self, emitted_ns: int) -> Block:
        """Return what tells the receiver of light that has left this host, first at this time."""
        block = self._emitted()
        pairs = block.symbols.size
        session = self._setup.session
        return Block(session, block.number, pairs, block.refills, emitted_ns, block.frames)

    def dark(self, why: str) -> Block:
        """No light came here: return what tells the receiver to let go of its halves."""
        block, self._why_dark = self._emitted(), why
        self._outbox.dark(block)
        self.statistics.lost_pairs += block.symbols.size
        return Block(self._setup.session, block.number, 0, 0, 0)

    def heard(self, report: Report, now_s: float) -> None:
        """Note what the receiver says of a block; raise SessionError if it cannot go on so."""
        self._require(State.REPORTING)
        assert self._block is not None
        self._state = State.IDLE
        if self._why_dark is None:
            self._note(self._block, report, now_s)
        else:
            self._give_up_if_dark(self._why_dark, now_s)

    def _require(self, state: State) -> None:
        if self._state is not state:
            raise ValueError(f"{self._state.name.lower()}, not {state.name.lower()}: await that")

    def _emitted(self) -> OutgoingBlock:
        self._require(State.EMITTING)
        assert self._block is not None
        self._state = State.REPORTING
        return self._block

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
                "(analyser.delay_line_km; `qmn spy RUN --kind bell-measure` tells)?",
            )

    def _give_up_if_too_noisy(self) -> None:
        for number, attempts in self._outbox.attempts.items():
            if attempts >= ATTEMPTS_LIMIT:
                raise SessionError(
                    Reason.TOO_NOISY,
                    f"frame {number} failed its check {attempts} times: the channel is too noisy "
                    f"for frames of {self._setup.frame_bytes} bytes; choose fewer "
                    "(--frame-bytes), a stronger code (--fec) or less noise",
                )


def _distinguishable_states(answer: Answer) -> int:
    if answer.symbols not in SYMBOLS:
        raise SessionError(Reason.PROTOCOL, "the receiver does not say what its analyser can do")
    return answer.symbols
