"""The emission of a source of Bell pairs: states, pairs in a pulse, and times.

Pairs in a pulse are counted by the statistics of the source: poisson for many modes of light,
thermal for one (Loudon, The Quantum Theory of Light, chapters 3 and 6). Several pairs of a pulse
are independent of each other: exact for many modes, an approximation for pairs of one mode, which
stimulate each other. Photons that a host prepares are counted alike: poisson is a laser, weakened
and without a fixed phase.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dispatcher.approximations import EXACT, STIMULATED, Approximations, approximation
from dispatcher.photon_random import PhotonRandom
from wire.parameters.physics import PairSource

FAR_SIGMAS = 6
MOST_PAIRS = 255  # in a pulse: fits a byte; rarer than 1e-10 at the largest mean


class Emission(NamedTuple):
    """Differences from one Phi+ in each of k pulses; None: no difference."""

    paulis: NDArray[np.uint8] | None  # on one half: the Bell state of that number
    pairs: NDArray[np.uint8] | None
    delays_ps: NDArray[np.float64] | None  # the same for both halves
    approximations: Approximations = EXACT

    @property
    def exact(self) -> bool:
        return not self.approximations


def emit(
    source: PairSource,
    random: PhotonRandom,
    levels: NDArray[np.uint8] | None = None,
    prepared: bool = False,
) -> Emission:
    """Draw what a source emits, one pulse for each photon of a half, with these intensities.

    Photons that are prepared may have been heralded, by the other halves of their pairs.
    """
    single = source.statistics == "single" and not source.g2
    pairs = None if single else _pairs(source, random)
    if pairs is not None and levels is not None:
        pairs = _weakened(pairs, levels, source.intensities, random)
    if pairs is not None and prepared and source.heralding_efficiency:
        pairs = _heralded(pairs, source.heralding_efficiency, random)
    return Emission(
        paulis=bell_states(source, random),
        pairs=pairs,
        delays_ps=_delays_ps(source.jitter_ps, pairs, random) if source.jitter_ps else None,
        approximations=_stimulated(source),
    )


def _stimulated(source: PairSource) -> Approximations:
    """Return what is approximated of a thermal source: of pulses with light, those of several."""
    if source.statistics != "thermal":
        return EXACT
    return approximation(STIMULATED, source.mean_pairs / (1 + source.mean_pairs))


def pair_probabilities(statistics: str, mean_pairs: float) -> NDArray[np.float64]:
    """Return how likely 0, 1, 2, … pairs are, up to MOST_PAIRS."""
    counts = np.arange(MOST_PAIRS + 1)
    if statistics == "thermal":
        return np.array((mean_pairs / (1 + mean_pairs)) ** counts / (1 + mean_pairs))
    factors = np.append(math.exp(-mean_pairs), mean_pairs / counts[1:])
    return np.cumprod(factors, dtype=np.float64)


def most_extra_pairs(source: PairSource, pulses: int) -> int:
    """Return how many pairs beside the first of a pulse there are at most, but for one in 1e9."""
    if source.statistics == "single":
        mean = source.multi_photon
        return math.ceil(pulses * mean + FAR_SIGMAS * math.sqrt(pulses * mean))
    if source.statistics == "none":
        return 0
    counts = np.maximum(np.arange(MOST_PAIRS + 1) - 1, 0)
    probabilities = pair_probabilities(source.statistics, source.mean_pairs)
    mean, square = float(counts @ probabilities), float(counts**2 @ probabilities)
    return int(pulses * mean + FAR_SIGMAS * (pulses * (square - mean**2)) ** 0.5) + 1


def bell_states(source: PairSource, random: PhotonRandom) -> NDArray[np.uint8] | None:
    """Draw the Bell states of pairs: which are not Phi+, then which they are; None: all are."""
    probabilities = source.bell_probabilities()
    others = sum(probabilities[1:])
    if others == 0:
        return None
    wrong = random.events("not Phi+", others)
    states = np.zeros(random.photons, dtype=np.uint8)
    states[wrong] = 1 + random.which_of("Bell state", wrong, probabilities[1:])
    return states


def _pairs(source: PairSource, random: PhotonRandom) -> NDArray[np.uint8]:
    """Draw the number of pairs in each pulse: first where there are any, then how many."""
    if source.statistics == "single":
        second: NDArray[np.bool_] = random.happens("second", source.multi_photon)
        return second.astype(np.uint8) + np.uint8(1)
    probabilities = pair_probabilities(source.statistics, source.mean_pairs)
    some = random.events("light", 1 - float(probabilities[0]))
    pairs = np.zeros(random.photons, dtype=np.uint8)
    pairs[some] = 1 + random.which("pairs", some.size, probabilities[1:])
    return pairs


def misprepared(source: PairSource, random: PhotonRandom) -> NDArray[np.uint8] | None:
    """Draw which Pauli each prepared state meets, so that it is wrong so often; None: none does.

    X, Z and XZ alike: two of them make a state wrong.
    """
    if not source.preparation_error:
        return None
    wrong = random.events("preparation", 1.5 * source.preparation_error)
    paulis = np.zeros(random.photons, dtype=np.uint8)
    paulis[wrong] = random.paulis_of("preparation, which", wrong)
    return paulis


def _heralded(
    pairs: NDArray[np.uint8], efficiency: float, random: PhotonRandom
) -> NDArray[np.uint8]:
    """Let pulses out of whose other halves the detector sees at least one, and no others."""
    some = np.flatnonzero(pairs > 0)
    missed = (1 - efficiency) ** pairs[some].astype(np.float64)
    detected = random.generator("herald").random(some.size) >= missed
    heralded = np.zeros_like(pairs)
    heralded[some[detected]] = pairs[some[detected]]
    return heralded


def _weakened(
    pairs: NDArray[np.uint8],
    levels: NDArray[np.uint8],
    intensities: tuple[float, ...],
    random: PhotonRandom,
) -> NDArray[np.uint8]:
    """Let of each pulse's photons as many pass as its intensity says: that is Poisson again."""
    shares = np.array(intensities) / intensities[0] if intensities[0] else np.ones(len(intensities))
    some = np.flatnonzero((pairs > 0) & (levels > 0))
    passed = random.generator("modulator").binomial(pairs[some], shares[levels[some]])
    weakened = pairs.copy()
    weakened[some] = passed.astype(np.uint8)
    return weakened


def _delays_ps(
    jitter_ps: float, pairs: NDArray[np.uint8] | None, random: PhotonRandom
) -> NDArray[np.float64]:
    """Draw how late each pulse leaves; one without light does not matter."""
    if pairs is None:
        return random.normal("jitter") * jitter_ps
    delays_ps = np.zeros(random.photons)
    some = np.flatnonzero(pairs > 0)
    delays_ps[some] = random.generator("jitter").standard_normal(some.size) * jitter_ps
    return delays_ps
