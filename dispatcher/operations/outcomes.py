"""Outcomes of measurements, kept for clicks alone, and how a reply reports them."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from dispatcher.devices.detector import Slots
from dispatcher.layer.weak_pulses import BasesAt
from dispatcher.sabot.backend import Bytes
from dispatcher.sabot.registers import Mask
from wire import dibits, gaps
from wire.dispatcher_pb2 import Feedback, MeasureRequest
from wire.outcomes import BASES, BELL_STATES, NO_CLICK


class Outcomes(NamedTuple):
    """The bits of clicks, or Bell states, by their slots."""

    slots: Slots
    bits: Bytes

    def of_all(self, count: int) -> Bytes:
        """Return the outcomes of all pulses, NO_CLICK where there is none."""
        outcomes = np.full(count, NO_CLICK, np.uint8)
        outcomes[self.slots] = self.bits
        return outcomes

    def each(self, bases: BasesAt) -> Callable[[int], str]:
        """Return what tells in which basis a photon was measured, and the outcome."""

        def of(position: int) -> str:
            return basis_and_outcome(bases(np.array([position])), self._of(position), 0)

        return of

    def bell_state(self, position: int) -> str:
        return outcome(self._of(position), BELL_STATES, 0)

    def _of(self, position: int) -> Bytes:
        place = int(self.slots.searchsorted(position))
        clicked = place < self.slots.size and self.slots[place] == position
        return self.bits[place : place + 1] if clicked else np.array([NO_CLICK], np.uint8)

    def tell_bell_states(self, feedback: Feedback, count: int, packed: bool) -> None:
        """Report Bell states of `count` pulses, most of them without an outcome."""
        feedback.coincidences = self.slots.size
        if packed:
            feedback.dibits = dibits.scattered(self.slots, self.bits, count, "little")
            feedback.missed = self._missed(count)
        else:
            feedback.outcomes = self.of_all(count).tobytes()

    def _missed(self, count: int) -> bytes:
        missed = np.full(-(-count // 8), 255, np.uint8)
        missed[-1] <<= np.uint8(-count % 8)
        at, bits = np.divmod(self.slots, 8)
        np.bitwise_xor.at(missed, at, np.uint8(128) >> bits.astype(np.uint8))
        return missed.tobytes() if self.slots.size < count else b""


def tell_gaps(feedback: Feedback, slots: Slots, bits: Bytes) -> None:
    feedback.gaps, feedback.bits = gaps.encode(slots), np.packbits(bits).tobytes()


def tell_bits(feedback: Feedback, outcomes: Bytes, request: MeasureRequest) -> None:
    if request.key:
        slots = np.flatnonzero(outcomes != NO_CLICK)
        tell_gaps(feedback, slots, outcomes[slots])
    elif request.packed:
        feedback.bits = np.packbits(outcomes & np.uint8(1)).tobytes()
        feedback.missed = _packed_mask(outcomes == NO_CLICK)
    else:
        feedback.outcomes = outcomes.tobytes()


def tell_bell_states(feedback: Feedback, outcomes: Bytes, packed: bool) -> None:
    missed = outcomes == NO_CLICK
    feedback.coincidences = missed.size - int(np.count_nonzero(missed))
    if packed:
        feedback.dibits = dibits.pack(outcomes & dibits.LARGEST, "little")
        feedback.missed = _packed_mask(missed)
    else:
        feedback.outcomes = outcomes.tobytes()


def _packed_mask(mask: Mask) -> bytes:
    """Return a mask as bits, the first in the highest bit of its byte; nothing if it has none."""
    return np.packbits(mask).tobytes() if mask.any() else b""


def outcome(outcomes: Bytes, names: tuple[str, ...], position: int) -> str:
    outcome = int(outcomes[position])
    return "no click" if outcome == NO_CLICK else names[outcome]


def basis_and_outcome(bases: Bytes, outcomes: Bytes, position: int) -> str:
    return f"{BASES[bases[position]]} {outcome(outcomes, ('0', '1'), position)}"
