"""The part of a session that is the same at both ends: its states, and messages with tags.

Bytes in, bytes out. `receive` takes one whole message of the other end (cut the stream by
messages.message_length) and returns the messages to send, in order. Whatever goes wrong
ends the session: no key at this end, an Abort with the reason to the other.
"""

import secrets
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum, auto
from math import isfinite

import numpy as np

from applications.qkd import disclosure
from applications.qkd.authentication import Authenticator, ForgedMessage, KeyPool, KeyPoolExhausted
from applications.qkd.bell_test import Correlations
from applications.qkd.bits import NO_BITS, Bits, Mask
from applications.qkd.decoy import Bounds, Decoys, Sifted, bounds
from applications.qkd.disclosure import Rule, compare
from applications.qkd.key_length import binary_entropy
from applications.qkd.messages import (
    MAX_KEY_BITS,
    Abort,
    AbortReason,
    QkdMessage,
    Sealed,
    unframe,
    unsealed,
)
from applications.qkd.parameters import Parameters
from applications.qkd.parities import ReconciliationError
from applications.qkd.relayed_decoys import PairSifted
from applications.qkd.relayed_decoys import bounds as relayed_bounds
from applications.qkd.sifting import Record
from hosts.middleware.session.estimation import Estimate
from wire.malformed import MalformedPacket

DOUBLINGS = 18  # of sifted bits, from those of a session that were too few, at most

RandomBytes = Callable[[int], bytes]


class State(Enum):
    OPENING = auto()  # bob waits for the proposal
    SIFTING = auto()
    ESTIMATING = auto()  # alice has disclosed her sample
    RECONCILING = auto()
    CONFIRMING = auto()  # one end is done; the other has the last word
    DONE = auto()
    ABORTED = auto()


class SessionFailed(Exception):
    """The session ends without a key; `first` are messages still to send before the Abort."""

    def __init__(self, reason: AbortReason, text: str, *first: QkdMessage) -> None:
        super().__init__(text)
        self.reason = reason
        self.first = first


@dataclass(frozen=True)
class Failure:
    reason: AbortReason
    text: str
    by_peer: bool  # the other end noticed


@dataclass(frozen=True)
class Report:
    """Counts of a session so far; all in bits."""

    raw: int  # photons that bob has detected
    sifted: int
    sample: int
    errors_in_sample: int
    errors_corrected: int
    leaked: int
    key: int
    authentication: int  # pre-shared key used by both directions

    @property
    def qber(self) -> float | None:
        """Error rate of the sample; None before there is one."""
        return self.errors_in_sample / self.sample if self.sample else None


@dataclass(frozen=True)
class Terms:
    """Names, parameters and the shared key of each direction of an end."""

    session: int
    parameters: Parameters
    outgoing: KeyPool
    incoming: KeyPool
    random_bytes: RandomBytes = secrets.token_bytes
    relayed: bool = False  # both ends have prepared light, and a relay has announced


class End(ABC):
    def __init__(self, terms: Terms) -> None:
        self._session = terms.session
        self._parameters = terms.parameters
        self._pools = terms.outgoing, terms.incoming
        self._signer, self._checker = (Authenticator(pool) for pool in self._pools)
        self._sent = self._received = 0
        self._random_bytes = terms.random_bytes
        self._clicks = self._pulses = 0
        self._parts: list[Bits] = []  # sifted, block by block
        self._bases: list[Bits] = []  # that they were measured in, likewise
        self.decoys: Decoys | None = None
        self._levels: Bits = NO_BITS  # intensities of the pulses of all sifted bits
        self._relayed = terms.relayed
        self._bobs_decoys: Decoys | None = None  # where he has sent pulses, too
        self._bobs_levels: Bits = NO_BITS
        # Bits by the intensities of their pulses, once the sample is disclosed.
        self._counts: Sifted | PairSifted | None = None
        self._raw: Bits = NO_BITS  # what is left of them to make a key of
        self.estimate: Estimate | None = None
        self.bell = Correlations()
        self._errors = self._leaked = 0
        self.state = State.SIFTING
        self.failure: Failure | None = None
        self.key: Bits | None = None

    @property
    def sifted_bits(self) -> int:
        """How long the sifted key is by now; applications.qkd.messages.MAX_KEY_BITS at most."""
        return sum(part.size for part in self._parts)

    @property
    def blocks_sifted(self) -> int:
        return len(self._parts)

    @property
    def multi_photon(self) -> float:
        """How likely a pulse of alice's source has several photons."""
        return self._parameters.multi_photon

    @property
    def single_share(self) -> float:
        """The share of the sifted bits that single photons have brought at least."""
        if self.decoys is not None:
            return self._single_share_by_decoys
        return self._parameters.single_share(self._pulses, self.sifted_bits)

    @property
    def _single_share_by_decoys(self) -> float:
        if self._counts is None:
            return 0.0
        return self._bounds().single / max(1, int(self._counts.key.sum()))

    def _bounds(self) -> Bounds:
        eps = self._parameters.eps_of_counts
        if isinstance(self._counts, PairSifted):
            return relayed_bounds(self._both_decoys, self._counts, eps)
        assert self.decoys is not None
        assert self._counts is not None
        return bounds(self.decoys, self._counts, eps)

    @property
    def report(self) -> Report:
        """Counts for the application and for diagnosis, also of a session without a key."""
        estimate = self.estimate
        return Report(
            self._clicks,
            self.sifted_bits,
            estimate.sample if estimate else 0,
            estimate.errors if estimate else 0,
            self._errors,
            self._leaked,
            self.key.size if self.key is not None else 0,
            sum(pool.consumed_bits for pool in self._pools),
        )

    def receive(self, data: bytes) -> list[bytes]:
        """Take one message of the other end; return the messages to send to it.

        An end that is done or has aborted sends nothing more. If the other end aborts after
        all, a key is withdrawn again: read on until the other end closes the connection.
        """
        if self.state is State.ABORTED:
            return []
        try:
            message = self._open(data)
        except (MalformedPacket, ForgedMessage, KeyPoolExhausted) as error:
            if self.state is State.DONE:
                return []
            return self._abort(_reason_of(error), str(error))
        if isinstance(message, Abort):
            self._end(Failure(AbortReason(message.reason), message.text, by_peer=True))
            return []
        return self._attempt(lambda: self._handle(message))

    @abstractmethod
    def is_quick(self, data: bytes) -> bool:
        """Whether `receive` takes less time with a message than to have it done elsewhere."""

    def cancel(self, text: str) -> list[bytes]:
        """End the session without a key, unless it has ended; return the messages to send."""
        if self.state in (State.DONE, State.ABORTED):
            return []
        return self._abort(AbortReason.CANCELLED, text)

    @abstractmethod
    def _handle(self, message: QkdMessage) -> list[QkdMessage]:
        """Take an authentic message in the state the session is in."""

    def _attempt(self, step: Callable[[], list[QkdMessage]]) -> list[bytes]:
        """Take a step; a failure of it ends the session."""
        sealed: list[bytes] = []
        try:
            for message in step():
                sealed.append(self._seal(message))  # those before a failure go out, too
        except SessionFailed as failed:
            sealed += self._abort(failed.reason, str(failed), *failed.first)
        except ReconciliationError as error:
            sealed += self._abort(AbortReason.PROTOCOL, str(error))
        return sealed

    def _keep(self, sifted: Record, photons: int, clicks: int) -> None:
        self._parts.append(sifted.outcomes)
        self._bases.append(sifted.bases)
        self._clicks += clicks
        self._pulses += photons
        if self.sifted_bits > MAX_KEY_BITS:
            raise SessionFailed(
                AbortReason.PROTOCOL,
                f"{self.sifted_bits} sifted bits in one session, at most {MAX_KEY_BITS}: "
                "distil after fewer blocks",
            )

    def _whole(self) -> Bits:
        return np.concatenate([NO_BITS, *self._parts])

    @property
    def _both_decoys(self) -> tuple[Decoys, Decoys]:
        """Alice's and bob's, once both are known."""
        assert self.decoys is not None
        assert self._bobs_decoys is not None
        return self.decoys, self._bobs_decoys

    @property
    def _rule(self) -> Rule:
        if self.decoys is None:
            return Rule.SAMPLE
        return Rule.BASIS_AND_SAMPLE if self._relayed else Rule.BASIS

    def _sample_of(self, seed: bytes) -> Mask:
        bases, fraction = np.concatenate(self._bases), self._parameters.test_fraction
        self._disclosed = disclosure.mask(self._rule, bases, fraction, seed)
        return self._disclosed

    def _sample_size(self) -> int:
        """Return how many sifted bits are disclosed; 0 if that would leave none."""
        bases = np.concatenate([NO_BITS, *self._bases])
        return disclosure.size(self._rule, bases, self._parameters.test_fraction)

    def _estimate_of(self, alices: Bits, bobs: Bits) -> Estimate:
        """Count errors of disclosed bits, and bits and errors by intensity, if there are several.

        Raise SessionFailed where bob's intensities are missing.
        """
        bases, wrong = np.concatenate(self._bases), alices != bobs
        if self._rule is Rule.BASIS:
            self._counts = Sifted.counted(self._levels, bases, wrong)
        elif self._rule is Rule.BASIS_AND_SAMPLE:
            if self._bobs_decoys is None:
                raise SessionFailed(AbortReason.PROTOCOL, "no intensities of bob's pulses")
            levels = self._levels, self._bobs_levels
            self._counts = PairSifted.counted(levels, bases, self._disclosed, wrong)
        chosen = disclosure.judged(self._rule, bases, self._disclosed)
        return compare(alices[chosen], bobs[chosen])

    def _judge(self, estimate: Estimate, *first: QkdMessage) -> None:
        """Note the error rate; raise SessionFailed if no key is possible."""
        self.estimate = estimate
        if estimate.qber > self._parameters.max_qber:
            raise SessionFailed(
                AbortReason.NOISY,
                f"{estimate.errors} of {estimate.sample} test bits are wrong "
                f"(QBER {estimate.qber:.4f}), at most {self._parameters.max_qber:.4f} is "
                "allowed: noise or an eavesdropper",
                *first,
            )
        if self._key_length(int(self._raw.size * binary_entropy(estimate.qber))) == 0:
            raise SessionFailed(AbortReason.TOO_SHORT, self._too_short(), *first)

    def _judge_bell(self) -> None:
        """Raise SessionFailed if there is a CHSH test, and it shows no entanglement."""
        if not self._parameters.chsh_fraction:
            return
        bell, least = self.bell, self.bell.least(self._parameters.chsh_margin)
        if not isfinite(bell.s):
            text = f"S needs a test in each pair of settings, of {bell.pairs} in all: make more"
            raise SessionFailed(AbortReason.LOCAL, f"{text} (--count)")
        if not bell.s > least:
            raise SessionFailed(
                AbortReason.LOCAL,
                f"S is {bell.s:.4f} of {bell.pairs} pairs, and must be above {least:.4f}: "
                "noise, an eavesdropper, or too few tests",
            )

    def _key_length(self, leaked_bits: int) -> int:
        assert self.estimate
        estimate = self.estimate
        if isinstance(self._counts, PairSifted):
            return self._parameters.relayed_key_length(self._both_decoys, self._counts, leaked_bits)
        if self.decoys is not None and self._counts is not None:
            return self._parameters.decoy_key_length(self.decoys, self._counts, leaked_bits)
        return self._parameters.key_length(
            self._raw.size, estimate.sample, estimate.qber, leaked_bits, self._pulses
        )

    def _too_short(self) -> str:
        assert self.estimate
        text = f"no secret bit in {self._raw.size} bits at a QBER of {self.estimate.qber:.4f}"
        if self.decoys is not None:
            return (
                f"{text}, of which {self.single_share:.1%} are of single photons as decoys say: "
                "lose less of the light, sift more in one session, or look for an eavesdropper"
            )
        if not self._parameters.multi_photon:
            return f"{text}: sift more photons in one session{self._bits_wanted()}"
        tagged = round((1 - self.single_share) * self.sifted_bits)
        return (
            f"{text}, of which {tagged} of {self.sifted_bits} sifted ones may be of pulses with "
            "several photons, which an eavesdropper can divide: use weaker pulses or a source "
            "of single photons, lose less of the light, or sift more in one session"
        )

    def _bits_wanted(self) -> str:
        """Return how many sifted bits would make a key at this error rate, as the end of a text."""
        assert self.estimate
        qber, size = self.estimate.qber, self._raw.size + self.estimate.sample
        for bits in (size << doubled for doubled in range(1, DOUBLINGS)):
            sample = round(bits * self.estimate.sample / size)
            left = bits - sample
            leaked = int(left * binary_entropy(qber))
            if self._parameters.key_length(left, sample, qber, leaked, 0):
                return f", some {round(bits, -2):,} bits (--count)"
        return ""

    def _open(self, data: bytes) -> QkdMessage:
        sealed: Sealed = unframe(data)
        if (sealed.session, sealed.sequence) != (self._session, self._received):
            raise ForgedMessage(
                f"message {sealed.sequence} of session {sealed.session:#x} where "
                f"{self._received} of {self._session:#x} is due"
            )
        self._checker.check(sealed.covered, sealed.tag)
        self._received += 1
        return sealed.open()

    def _seal(self, message: QkdMessage) -> bytes:
        """Return a message with its tag; the last pad is kept for an Abort."""
        if self._signer.messages_left < 2 and not isinstance(message, Abort):
            raise SessionFailed(
                AbortReason.NO_AUTHENTICATION_KEY,
                f"the key for authentication is used up after {self._sent} messages: "
                "share more of it before the session",
            )
        data = unsealed(message, self._session, self._sent)
        self._sent += 1
        return data + self._signer.tag(data)

    def _abort(self, reason: AbortReason, text: str, *first: QkdMessage) -> list[bytes]:
        self._end(Failure(reason, text, by_peer=False))
        capacity = max(0, self._signer.messages_left - 1)
        last = [Abort(reason, text)] if self._signer.messages_left else []
        return [self._seal(message) for message in [*first[:capacity], *last]]

    def _end(self, failure: Failure) -> None:
        self.state, self.failure, self.key = State.ABORTED, failure, None
        self._raw = NO_BITS


def out_of_place(message: QkdMessage, state: State) -> SessionFailed:
    return SessionFailed(
        AbortReason.PROTOCOL, f"{type(message).__name__} while {state.name.lower()}"
    )


def _reason_of(error: Exception) -> AbortReason:
    if isinstance(error, MalformedPacket):
        return AbortReason.MALFORMED
    if isinstance(error, KeyPoolExhausted):
        return AbortReason.NO_AUTHENTICATION_KEY
    return AbortReason.FORGED
