"""The light of a block besides its quantum states, as it is thinned, divided and united.

Arrays are never changed in place: both halves of a block and its parts may share them. They are
multiplied by masks, which takes the same time whatever is masked; np.where is slow where that is
random.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import reduce
from operator import or_
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from dispatcher.fiber.noise import Effect
from dispatcher.fiber.turn import gathered, merged
from dispatcher.layer.ownership import Block, Pulses
from dispatcher.photon_random import PhotonRandom
from dispatcher.sabot.registers import Mask

MOST_EXTRAS = 255


def lit(block: Block) -> Mask:
    """Return in which pulses of a block there is light: a photon of its own, or another."""
    present, extras = block.register.present, block.pulses.extras
    return present if extras is None else present | (extras > 0)


def pass_on(pulses: Pulses, members: Mask, effect: Effect) -> None:
    pulses.approximations |= effect.approximations
    if effect.angles_rad is not None:
        pulses.angles_rad = _added(pulses.angles_rad, effect.angles_rad, members)
    if effect.delays_ps is not None:
        pulses.delays_ps = _added(pulses.delays_ps, effect.delays_ps, members)
    if effect.extras is not None:
        pulses.extras = _filled(pulses.extras, effect.extras * members)


def thin(
    pulses: Pulses,
    members: Mask,
    transmission: float | NDArray[np.float64],
    random: PhotonRandom,
    purpose: str,
) -> None:
    """Let each further photon of the members' pulses through with this probability."""
    if pulses.extras is None:
        return
    there = np.flatnonzero((pulses.extras > 0) & members)
    owners = np.repeat(there, pulses.extras[there])
    if isinstance(transmission, np.ndarray):
        transmission = transmission[owners]
    lost = owners[random.generator(purpose).random(owners.size) >= transmission]
    extras = pulses.extras.copy()
    np.subtract.at(extras, lost, np.uint8(1))
    pulses.extras = extras


def darken(pulses: Pulses, members: Mask) -> None:
    if pulses.extras is not None:
        pulses.extras = pulses.extras * ~members


def part(pulses: Pulses, members: Mask) -> Pulses:
    return split_noise(pulses, None if pulses.extras is None else pulses.extras * members)


def split_noise(pulses: Pulses, extras: NDArray[np.uint8] | None) -> Pulses:
    """Move so much noise of each pulse into a part of its own; None if there is none at all."""
    separated = replace(pulses, extras=extras)
    if pulses.extras is not None and extras is not None:
        pulses.extras = pulses.extras - extras
    return separated


def unite(pulses: Pulses, other: Pulses, members: Mask) -> None:
    pulses.approximations |= other.approximations
    if other.extras is not None:
        pulses.extras = _filled(pulses.extras, other.extras)
    pulses.delays_ps = _merged(pulses.delays_ps, other.delays_ps, members)
    pulses.angles_rad = _merged(pulses.angles_rad, other.angles_rad, members)
    pulses.polarization = merged(pulses.polarization, other.polarization, members)


def gather(picks: Sequence[tuple[Pulses, NDArray[np.uint32]]]) -> Pulses:
    """Return the pulses at these positions of several blocks, one after the other."""
    every = [pulses for pulses, _positions in picks]

    def joined(arrays: Sequence[NDArray[Any] | None], dtype: DTypeLike) -> NDArray[Any] | None:
        if all(array is None for array in arrays):
            return None
        parts = [
            np.zeros(at.size, dtype) if array is None else array[at]
            for array, (_pulses, at) in zip(arrays, picks, strict=True)
        ]
        return np.concatenate(parts)

    return Pulses(
        extras=joined([pulses.extras for pulses in every], np.uint8),
        delays_ps=joined([pulses.delays_ps for pulses in every], np.float64),
        angles_rad=joined([pulses.angles_rad for pulses in every], np.float64),
        polarization=gathered([(pulses.polarization, at) for pulses, at in picks]),
        encoding=every[0].encoding,
        bandwidth_nm=max(pulses.bandwidth_nm for pulses in every),
        dispersion_ps_per_nm=max((pulses.dispersion_ps_per_nm for pulses in every), key=abs),
        frequency_mhz=max(pulses.frequency_mhz for pulses in every),
        approximations=reduce(or_, (pulses.approximations for pulses in every)),
    )


def _filled(extras: NDArray[np.uint8] | None, more: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return the sum of two counts of photons in each pulse, MOST_EXTRAS at most."""
    return more if extras is None else extras + np.minimum(more, MOST_EXTRAS - extras)


def _added(
    values: NDArray[np.float64] | None, more: NDArray[np.float64], members: Mask
) -> NDArray[np.float64]:
    if members.all():
        return more if values is None else values + more
    added = more * members
    if values is not None:
        added += values
    return added


def _merged(
    values: NDArray[np.float64] | None, other: NDArray[np.float64] | None, members: Mask
) -> NDArray[np.float64] | None:
    if values is None and other is None:
        return None
    here, there = (0.0 if array is None else array for array in (values, other))
    return there * members + here * ~members


def retime(pulses: Pulses) -> None:
    """Let light that a memory gives out come when it is wanted: without jitter or dispersion."""
    pulses.delays_ps, pulses.dispersion_ps_per_nm = None, 0.0


def late_ps(pulses: Pulses, random: PhotonRandom) -> NDArray[np.float64] | None:
    """Return how late each pulse comes to a detector, shape (k,); None: none does.

    Light that fibres have dispersed is late by the offset of its wavelength, the same in all.
    """
    spread_ps = pulses.bandwidth_nm * pulses.dispersion_ps_per_nm
    if not spread_ps:
        return pulses.delays_ps
    offsets = random.normal("wavelength") * spread_ps
    return offsets if pulses.delays_ps is None else pulses.delays_ps + offsets
