"""The overlap of two photons in time and colour, which decides how well they interfere.

Photons of Gaussian spectra, of rms widths s and s' of their intensity (rad/s), that come apart by
tau, one of them more dispersed by b (s^2, the phase being b w^2 / 2), overlap by

    |<1|2>|^2 = 2 s s' / (s^2 + s'^2) / sqrt(1 + c^2) exp(-tau^2 / (2 a (1 + c^2)))

with a = (1/s^2 + 1/s'^2) / 4 and c = b / 2a: the squared Fourier integral of both amplitudes. Of
equal spectra without dispersion it is exp(-(s tau)^2), as in the dip of Hong, Ou and Mandel (Phys.
Rev. Lett. 59, 2044): the coherence time is 1 / s. Where dispersion is the same in both arms it
cancels (Steinberg, Kwiat, Chiao, Phys. Rev. A 45, 6659).
"""

import math
from typing import NamedTuple

import numpy as np

from dispatcher.devices.decay import Each
from wire.optical import DEFAULT_FREQUENCY_MHZ

LIGHT_M_PER_S = 299_792_458.0
FREQUENCY_HZ = DEFAULT_FREQUENCY_MHZ * 1e6


class Overlap(NamedTuple):
    """The overlap of photons that come together, and how it falls as they come apart."""

    most: float = 1.0
    rad_per_s: float = 0.0  # falls as exp(-(rad_per_s tau)^2); 0: light of one colour, however late

    def apart(self, mismatch_ps: Each) -> Each:
        """Return how far photons overlap that come so far apart."""
        fallen: Each = self.most * np.exp(-((self.rad_per_s * 1e-12 * mismatch_ps) ** 2))
        return fallen


def angular_width(bandwidth_nm: float) -> float:
    """Return a width in rad/s of one in nm: 2 pi f^2 / c times it, at the default wavelength."""
    return 2 * math.pi * FREQUENCY_HZ**2 / LIGHT_M_PER_S * bandwidth_nm * 1e-9


def overlap(
    bandwidths_nm: tuple[float, float], dispersion_ps_per_nm: float, filter_rad_per_s: float
) -> Overlap:
    """Return the overlap of two photons, one of them so much more dispersed.

    A filter gives both its own width. Where a width is 0 nothing is known of it, and they overlap.
    """
    widths = [filter_rad_per_s or angular_width(each_nm) for each_nm in bandwidths_nm]
    if not all(widths):
        return Overlap()
    one, other = widths
    spread = (1 / one**2 + 1 / other**2) / 4
    chirp = dispersion_ps_per_nm * 1e-12 / angular_width(1.0) / (2 * spread)
    stretched = 1 + chirp**2
    most = 2 * one * other / (one**2 + other**2) / math.sqrt(stretched)
    return Overlap(most, 1 / math.sqrt(2 * spread * stretched))
