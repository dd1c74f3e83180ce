"""What a fibre or a switch does to the photons that pass it.

A noise model turns physical parameters into erasures and Paulis; it does not simulate.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

# Called with a purpose, gives a number from [0, 1) for each photon of a block.
Uniform = Callable[[str], NDArray[np.float64]]


class Effect(NamedTuple):
    """What happens to each of k photons; None where nothing does."""

    lost: NDArray[np.bool_] | None = None
    paulis: NDArray[np.uint8] | None = None
    # Coherent rotation about the Z axis. Angles add up and become a Pauli at the measurement.
    angles_rad: NDArray[np.float64] | None = None
    delays_ps: NDArray[np.float64] | None = None
    transmission: float = 1.0  # how likely light that is in the same pulse comes through
    exact: bool = True  # whether this is what the physics does, or an approximation of it


class NoiseModel(Protocol):
    """One kind of noise with its parameters."""

    def effect(self, uniform: Uniform) -> Effect:
        """Draw what happens to each photon."""


@dataclass(frozen=True)
class Loss:
    """Photons are absorbed: of an attenuation in dB, 10^(-loss_db / 10) come through."""

    loss_db: float

    def effect(self, uniform: Uniform) -> Effect:
        """Draw which photons are lost."""
        if self.loss_db == 0:
            return Effect()
        return Effect(lost=uniform("loss") >= 10 ** (-self.loss_db / 10))


@dataclass(frozen=True)
class Depolarizing:
    """With probability p a photon is replaced by noise: X, Z and XZ happen with p/4 each."""

    p: float

    def effect(self, uniform: Uniform) -> Effect:
        """Draw a Pauli for each photon."""
        if self.p == 0:
            return Effect()
        quarter = uniform("depolarizing") * (4 / self.p)
        return Effect(paulis=np.where(quarter < 4, quarter, 0).astype(np.uint8))
