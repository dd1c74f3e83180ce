"""The overlap of two photons, which decides how well they interfere: in time and colour, as here.

Photons of Gaussian spectra, of rms widths s and s' of their intensity (rad/s) and d apart, that
come apart by tau, with phases b w^2 / 2 and b' w^2 / 2 by dispersion about their own colours,
overlap by the squared Fourier integral of both amplitudes. With p = 1/4s^2 + ib/2 and
q = 1/4s'^2 - ib'/2 it is

    |<1|2>|^2 = 1/(2 s s' |p + q|) exp(2 Re[((2 q d + i tau)^2 / 4(p + q)) - q d^2])

Of equal spectra without dispersion it is exp(-(s tau)^2 - (d / 2s)^2), for d = 0 the dip of Hong,
Ou and Mandel (Phys. Rev. Lett. 59, 2044): the coherence time is 1 / s. Where dispersion is the same
in both arms it cancels (Steinberg, Kwiat, Chiao, Phys. Rev. A 45, 6659).

Photons of two arms at a balanced beam splitter, and the detectors behind either output.

    a ---.   .--- c: polarising beam splitter, detectors H and V      a_s -> (c_s + d_s) / sqrt 2
          \\ /
          / \
    b ---'   '--- d: polarising beam splitter, detectors H and V      b_s -> (c_s - d_s) / sqrt 2

A pulse of n photons in the state s is a_s^n |0>: the creation operators multiply, and how many
photons leave by each of the four modes is a coefficient of a polynomial (Hong, Ou, Mandel, Phys.
Rev. Lett. 59, 2044, for one in each arm). Where exactly two detectors of different polarisation
click, those of one output tell Psi+, those of both Psi- (Lo, Curty, Qi, Phys. Rev. Lett. 108,
130503); all else is not an outcome. Time-bin qubits have early and late for H and V.
"""

import math
from functools import lru_cache
from math import factorial, prod
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dispatcher.devices.decay import Each
from dispatcher.devices.detectors import Bits, Detection, ExtraBits, hide
from wire.optical import DEFAULT_FREQUENCY_MHZ
from wire.outcomes import BELL_STATES

MODES = 4  # c H, c V, d H, d V
PSI_PLUS, PSI_MINUS = BELL_STATES.index("Psi+"), BELL_STATES.index("Psi-")
MOST_PHOTONS = 10  # of both arms: with more, each goes its own way
HALF = 0.5**0.5
# The six cardinal states, as dispatcher.operations.emission numbers them.
AMPLITUDES = ((1, 0), (0, 1), (HALF, HALF), (HALF, -HALF), (HALF, HALF * 1j), (HALF, -HALF * 1j))

Polynomial = dict[tuple[int, ...], complex]  # coefficients by powers of the four modes
Numbers = NDArray[np.int64]


class Outputs(NamedTuple):
    """How many photons leave by each mode, shape (p, 4), and how likely, shape (p,)."""

    photons: NDArray[np.uint8]
    chances: NDArray[np.float64]


@lru_cache(maxsize=4096)
def outputs(first: tuple[int, ...], second: tuple[int, ...]) -> Outputs:
    """Return the outputs of photons in these cardinal states in either arm; ascending numbers."""
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
        for mode, coefficient in enumerate(factor):
            raised = (*powers[:mode], powers[mode] + 1, *powers[mode + 1 :])
            product[raised] = product.get(raised, 0.0) + amplitude * coefficient
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


def detected_in(polarisation: int, pulses: Numbers, modes: Bits) -> ExtraBits:
    """Return what comes to the two detectors of a polarisation: bit 0 that of c, 1 that of d."""
    here = modes & 1 == polarisation
    return ExtraBits(pulses[here], modes[here] >> 1)


def read(detections: tuple[Detection, Detection]) -> Bits:
    """Return what the detectors of H and V tell: Psi+, Psi-, or NO_CLICK for all else."""
    clicked = [detection.once for detection in detections]
    one, other = (detection.bits for detection in detections)
    states = np.where(one == other, np.uint8(PSI_PLUS), np.uint8(PSI_MINUS))
    return hide(states, ~(clicked[0] & clicked[1]))


LIGHT_M_PER_S = 299_792_458.0
FREQUENCY_HZ = DEFAULT_FREQUENCY_MHZ * 1e6


class Overlap(NamedTuple):
    """The overlap of photons that come best together, and how it falls as they come apart."""

    most: Each = 1.0
    rad_per_s: float = 0.0  # falls as exp(-(rad_per_s tau)^2); 0: light of one colour, however late
    best_ps: float = 0.0  # the mismatch at which it is most; other than 0 of two colours

    def apart(self, mismatch_ps: Each) -> Each:
        """Return how far photons overlap of which the first comes so much later."""
        apart_ps = mismatch_ps - self.best_ps
        fallen: Each = self.most * np.exp(-((self.rad_per_s * 1e-12 * apart_ps) ** 2))
        return fallen

    def least(self, most_ps: float) -> float:
        """Return how far photons overlap at least that come so far apart at most."""
        return float(np.min(self.apart(self.best_ps + abs(self.best_ps) + most_ps)))

    def of(self, photons: NDArray[np.integer]) -> "Overlap":
        return self._replace(most=self.most[photons]) if isinstance(self.most, np.ndarray) else self


class Spectrum(NamedTuple):
    bandwidth_nm: float = 0.0  # rms; 0: unknown
    dispersion_ps_per_nm: float = 0.0  # of all fibres so far
    frequency_mhz: int = 0  # 0: that of the other one


def angular_width(bandwidth_nm: float) -> float:
    """Return a width in rad/s of one in nm: 2 pi f^2 / c times it, at the default wavelength."""
    return 2 * math.pi * FREQUENCY_HZ**2 / LIGHT_M_PER_S * bandwidth_nm * 1e-9


def overlap(first: Spectrum, second: Spectrum, filter_rad_per_s: float) -> Overlap:
    """Return the overlap of two photons.

    A filter gives both its own width. Where only one width is known, both photons are as wide;
    where none is, they overlap if they are of one colour, and not at all if they are of two.
    """
    spectra = first, second
    apart_mhz = second.frequency_mhz - first.frequency_mhz if all(s[2] for s in spectra) else 0
    widths = [filter_rad_per_s or angular_width(spectrum.bandwidth_nm) for spectrum in spectra]
    if not any(widths):
        return Overlap(0.0 if apart_mhz else 1.0)
    widths = [width or max(widths) for width in widths]
    d = 2e6 * math.pi * apart_mhz
    # Longer wavelengths come later: the phase of frequencies has the other sign.
    p, q = (
        complex(1 / (4 * width**2), sign * each.dispersion_ps_per_nm * 1e-12 / angular_width(2.0))
        for width, each, sign in zip(widths, spectra, (-1, 1), strict=True)
    )
    curvature = (1 / (p + q)).real / 2
    shift = (q / (p + q)).imag * d / curvature  # s
    most = abs(1 / (p + q)) / (2 * math.prod(widths))
    most *= math.exp(curvature * shift**2 - 2 * d**2 * (p * q / (p + q)).real)
    return Overlap(most, math.sqrt(curvature), shift * 1e12)
