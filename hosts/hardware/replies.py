"""The replies of a QNIC, read from the feedback of steps, and its errors.

Outcomes come in the fewest bytes: eight to a byte, or four Bell states.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wire import dibits, gaps
from wire.dispatcher_pb2 import Feedback
from wire.outcomes import NO_COINCIDENCE

Symbols = NDArray[np.uint8]


class HardwareError(Exception):
    """The hardware refused or failed; the text names the value and the remedy."""


class NoLight(HardwareError):
    """No photon of a block arrived in time."""


class NotHere(HardwareError):
    """A block is not at this host."""


@dataclass(frozen=True)
class Coincidences:
    """The Bell analyser's report of a block: Bell states, 255 where it saw none."""

    outcomes: Symbols  # shape (k,): 0 Phi+, 1 Psi+, 2 Phi-, 3 Psi-
    clicks: int
    time_ns: int


@dataclass(frozen=True)
class Outcomes:
    """The detectors' report of a block: 0 or 1 for each photon, 255 where none clicked."""

    outcomes: Symbols  # shape (k,)
    time_ns: int


@dataclass(frozen=True)
class Clicks:
    """The detectors' report of a block of which few photons may have been detected."""

    photons: int
    at: NDArray[np.int64]  # which were, shape (m,), ascending
    bits: Symbols  # shape (m,)


@dataclass(frozen=True)
class Stored:
    arrived: NDArray[np.bool_]  # shape (k,): whether each photon is in it
    since_ns: int  # the mean time from which they wait there


@dataclass(frozen=True)
class Received:
    """Received light: places for photons, and when the first and last of them came."""

    photons: int
    first_ns: int
    last_ns: int


def symbols_of(feedback: Feedback) -> Symbols:
    """Return outcomes that are a byte each."""
    return np.frombuffer(feedback.outcomes, dtype=np.uint8)


def bits_of(feedback: Feedback) -> Symbols:
    """Return packed outcomes of a measurement: 0 or 1, 255 where no detector clicked."""
    return _with_missed(_unpacked(feedback.bits, feedback.photons), feedback)


def clicks_of(feedback: Feedback) -> Clicks:
    """Return what a measurement in bases of a key has found."""
    try:
        at = gaps.decode(feedback.gaps, feedback.photons)
    except ValueError as error:
        raise HardwareError(f"the dispatcher tells {error}") from error
    return Clicks(feedback.photons, at, _unpacked(feedback.bits, at.size))


def coincidences_of(feedbacks: Sequence[Feedback]) -> Coincidences:
    feedback = feedbacks[-1]
    outcomes = dibits.unpack(feedback.dibits, feedback.photons, "little")
    return Coincidences(_with_missed(outcomes, feedback), feedback.clicks, feedback.time_ns)


def stored_of(arrived: bytes, light: Feedback) -> Stored:
    """Return what was stored of light that came, or left its source, evenly in time."""
    return Stored(np.frombuffer(arrived, dtype=bool), (light.first_ns + light.last_ns) // 2)


def _with_missed(outcomes: Symbols, feedback: Feedback) -> Symbols:
    if feedback.missed:
        outcomes |= _unpacked(feedback.missed, feedback.photons) * np.uint8(NO_COINCIDENCE)
    return outcomes


def _unpacked(packed: bytes, count: int) -> Symbols:
    if len(packed) != (count + 7) // 8:
        raise HardwareError(f"the dispatcher tells {len(packed)} bytes of {count} bits")
    return np.unpackbits(np.frombuffer(packed, np.uint8), count=count)
