"""The state of two qubits that have attempted to emit, by the clicks at the station between them.

The light of both meets at a balanced beam splitter with a detector behind either output, which
tells light from none. All that may have happened in an attempt is enumerated: who has emitted,
whose light was lost, where it went, which detector has clicked in the dark. A herald is

    two-click     one click in each of the two modes that a photon may be in: of the same detector
                  Psi+, of different ones Psi- (Barrett and Kok, Phys. Rev. A 71, 060310)
    single-click  one click in the only mode; which detector tells Psi+ from Psi- (Cabrillo, Cirac,
                  Garcia-Fernandez, Zoller, Phys. Rev. A 59, 1025)

Where both photons, or the one that nobody can know the origin of, have made it, the qubits are
entangled; otherwise they are in a state of the Z basis, 1 being the qubit that has emitted
(two-click: into the second mode). Two photons in one mode leave together if they are
indistinguishable, and with (1 - V) / 2 by different outputs (Hong, Ou, Mandel, Phys. Rev. Lett. 59,
2044).
"""

from math import exp, sqrt
from typing import NamedTuple

from dispatcher.devices.decay import Each

ENTANGLED = "entangled"
KINDS = (ENTANGLED, "00", "01", "10", "11")  # what the qubits are in, of the two hosts in order


class Arm(NamedTuple):
    """One of the hosts, as a station sees it."""

    efficiency: float  # of an emission: the detector at the end clicks
    bright_state: float = 0.5  # how likely its qubit emits
    phase_rad: float = 0.0  # rms of its light's phase


class Heralds(NamedTuple):
    """How likely an attempt is heralded, with what the qubits are in; by KINDS."""

    chances: tuple[float, ...]
    coherence: float  # of the entangled ones: how far Psi+ differs from Psi-, phases apart
    unequal: float  # how far a qubit of those is from either state alike: 0 of a Bell state
    first: float = 0.5  # of single photons that click, how many are of the first host

    @property
    def probability(self) -> float:
        return sum(self.chances)


def two_click(arms: tuple[Arm, Arm], dark: float, visibility: float) -> Heralds:
    """Return the heralds of emission into one of two modes; dark: of a detector, in a mode."""
    a, b = (arm.efficiency for arm in arms)
    one = 1 - dark  # given light at one detector: the other stays dark
    nothing = 2 * dark * (1 - dark)  # of exactly one click without light
    together = one * (1 + visibility) / 2
    alike = nothing * (
        a * b * together + (a * (1 - b) + b * (1 - a)) * one + (1 - a) * (1 - b) * nothing
    )
    apart = (a * (1 - b) + b * (1 - a)) * one * nothing + (1 - a) * (1 - b) * nothing**2
    entangled = a * b * one**2 / 2
    chances = entangled, alike / 4, apart / 4, apart / 4, alike / 4
    return Heralds(chances, 1.0, 0.0, a / (a + b) if a + b else 0.5)


def single_click(arms: tuple[Arm, Arm], dark: float, visibility: float) -> Heralds:
    """Return the heralds of emission or none; dark: how likely a detector clicks without light."""
    (a, bright_a, phase_a), (b, bright_b, phase_b) = arms
    one, nothing = 1 - dark, 2 * dark * (1 - dark)
    only_a, only_b = bright_a * (1 - bright_b), bright_b * (1 - bright_a)
    seen_a, seen_b = only_a * a, only_b * b
    both = (
        bright_a
        * bright_b
        * (
            a * b * one * (1 + visibility) / 2
            + (a * (1 - b) + b * (1 - a)) * one
            + (1 - a) * (1 - b) * nothing
        )
    )
    chances = (
        (seen_a + seen_b) * one,
        (1 - bright_a) * (1 - bright_b) * nothing,
        only_b * (1 - b) * nothing,
        only_a * (1 - a) * nothing,
        both,
    )
    balanced = 2 * sqrt(seen_a * seen_b) / (seen_a + seen_b) if seen_a + seen_b else 0.0
    coherence = balanced * exp(-(phase_a**2 + phase_b**2) / 2)
    first = seen_a / (seen_a + seen_b) if seen_a + seen_b else 0.5
    return Heralds(chances, coherence, abs(2 * first - 1) / 2, first)


def phase_wrong(scheme: str, heralds: Heralds, visibility: Each) -> Each:
    """Return how likely an entangled pair has the other phase than its clicks tell.

    Distinguishable light reveals where it came from: for two photons that costs V, for one
    photon of unknown origin the overlap of the amplitudes, the square root of V.
    """
    overlap = visibility if scheme == "two-click" else visibility**0.5
    return (1 - heralds.coherence * overlap) / 2
