"""Photons of two arms at a balanced beam splitter, and the detectors behind either output.

    a ---.   .--- c: polarising beam splitter, detectors H and V      a_s -> (c_s + d_s) / sqrt 2
          \\ /
          / \\
    b ---'   '--- d: polarising beam splitter, detectors H and V      b_s -> (c_s - d_s) / sqrt 2

A pulse of n photons in the state s is a_s^n |0>: the creation operators multiply, and how many
photons leave by each of the four modes is a coefficient of a polynomial (Hong, Ou, Mandel, Phys.
Rev. Lett. 59, 2044, for one in each arm). Where exactly two detectors of different polarisation
click, those of one output tell Psi+, those of both Psi- (Lo, Curty, Qi, Phys. Rev. Lett. 108,
130503); all else is not an outcome. Time-bin qubits have early and late for H and V.
"""

from functools import lru_cache
from math import factorial, prod
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dispatcher.devices.detectors import Bits, Detection, Told, hide
from wire.outcomes import BELL_STATES

MODES = 4  # c H, c V, d H, d V
PSI_PLUS, PSI_MINUS = BELL_STATES.index("Psi+"), BELL_STATES.index("Psi-")
MOST_PHOTONS = 10  # of both arms: with more, each goes its own way
HALF = 0.5**0.5
# The six cardinal states, as dispatcher.operations.preparation numbers them.
AMPLITUDES = ((1, 0), (0, 1), (HALF, HALF), (HALF, -HALF), (HALF, HALF * 1j), (HALF, -HALF * 1j))

Polynomial = dict[tuple[int, ...], complex]  # coefficients by powers of the four modes
Numbers = NDArray[np.int64]


class Outputs(NamedTuple):
    """How many photons leave by each mode, shape (p, 4), and how likely, shape (p,)."""

    photons: NDArray[np.uint8]
    chances: NDArray[np.float64]


@lru_cache(maxsize=4096)
def outputs(first: tuple[int, ...], second: tuple[int, ...]) -> Outputs:
    """Return what comes of photons in these cardinal states in either arm; ascending numbers."""
    state: Polynomial = {(0,) * MODES: 1.0}
    for states, sign in ((first, 1), (second, -1)):
        for number in states:
            h, v = AMPLITUDES[number]
            state = _times(state, (h, v, sign * h, sign * v))
    weights = {
        powers: abs(amplitude) ** 2 * prod(map(factorial, powers))
        for powers, amplitude in state.items()
    }
    chances = np.array(list(weights.values()))
    return Outputs(np.array(list(weights), np.uint8), chances / chances.sum())


def _times(state: Polynomial, factor: tuple[complex, ...]) -> Polynomial:
    product: Polynomial = {}
    for powers, amplitude in state.items():
        for mode, own in enumerate(factor):
            raised = (*powers[:mode], powers[mode] + 1, *powers[mode + 1 :])
            product[raised] = product.get(raised, 0.0) + amplitude * own
    return product


def of_bell_states(states: Bits, coins: Bits) -> NDArray[np.uint8]:
    """Return the two modes by which the photons of a pair leave; shape (k, 2), coins of two bits.

    Psi- leaves by both outputs, Psi+ by one, and Phi+ and Phi- by one of them in one polarisation.
    """
    output, other = (coins & 1) << 1, coins >> 1
    psi = (states & 1).astype(bool)
    apart = (states == PSI_MINUS).astype(np.uint8) << 1
    one = np.where(psi, output, output + other)
    two = np.where(psi, (output ^ apart) + 1, output + other)
    return np.stack([one, two], axis=1).astype(np.uint8)


def told_to(polarisation: int, pulses: Numbers, modes: Bits) -> Told:
    """Return what comes to the two detectors of a polarisation: bit 0 that of c, 1 that of d."""
    own = modes & 1 == polarisation
    return Told(pulses[own], modes[own] >> 1)


def read(found: tuple[Detection, Detection]) -> Bits:
    """Return what the detectors of H and V tell: Psi+, Psi-, or NO_CLICK for all else."""
    seen = [detection.once for detection in found]
    one, other = (detection.bits for detection in found)
    states = np.where(one == other, np.uint8(PSI_PLUS), np.uint8(PSI_MINUS))
    return hide(states, ~(seen[0] & seen[1]))
