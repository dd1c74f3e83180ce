"""Attacks by bright light, on detectors and on sources: what eve knows of a sifted key.

    alice === eve === bob        blinding: she measures alice's photons, and makes bob's clicks
    alice <== eve                Trojan horse: she reads the modulator by light of her own

Neither makes an error, so no sample finds them: devices that watch for light do.

Bright light on devices that are made for single photons: it blinds detectors and reads sources.

An avalanche photodiode in continuous light loses the voltage that lets one photon start an
avalanche. It is then an ordinary photodiode behind a comparator: it clicks for a pulse above a
power, whatever the pulse's photons are (Lydersen et al., Nature Photonics 4, 686, 2010; thresholds
of that order). A monitor of the photocurrent sees the continuous light (Yuan, Dynes, Shields, Appl.
Phys. Lett. 98, 231104, 2011).

A source sends some of the light back that somebody sends into it, modulated as its own (Gisin et
al., Phys. Rev. A 73, 022320, 2006). An isolator weakens it on its way in; a monitor sees it.

Such light is classical: powers, mean photon numbers and polarisations say all of it.
"""

import asyncio
from dataclasses import dataclass
from math import exp, inf, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from applications.qkd.key_length import asymptotic_fraction
from dispatcher.sabot.backend import Bytes
from dispatcher.sabot.registers import Mask
from evidence.attacks.photons import SEED, Spied
from evidence.curves.bb84 import TO_EVE
from evidence.curves.link import configuration, fiber
from evidence.laboratory import Laboratory
from wire.outcomes import NO_CLICK

Powers = NDArray[np.float64]

_ROOT = 2**-0.5
# Amplitudes of the states that hosts prepare (wire/dispatcher.proto: 2 * basis + bit, Z then X).
STATES = np.array([[1.0, 0.0], [0.0, 1.0], [_ROOT, _ROOT], [_ROOT, -_ROOT]])


def shares(states: Bytes, bases: Bytes) -> Powers:
    """Return which share of light of these states each arm of a measurement gets, shape (k, 2)."""
    analysers = STATES.reshape(2, 2, 2)[bases]  # by photon, arm, amplitude
    amplitudes: Powers = np.einsum("kab,kb->ka", analysers, STATES[states])
    return amplitudes**2


@dataclass(frozen=True)
class AvalanchePhotodiode:
    """A single-photon detector and what it does in bright light."""

    blinding_w: float = 400e-6  # continuous light from which no single photon is seen
    never_w: float = 650e-6  # peak of a pulse up to which it never clicks while it is blind
    always_w: float = 930e-6  # from which it always does; in between the likelihood rises evenly
    responsivity_a_per_w: float = 1.0  # of the diode without an avalanche
    alarm_a: float = inf  # photocurrent at which its monitor tells; inf: it has none

    def is_blind(self, continuous_w: float) -> bool:
        return continuous_w >= self.blinding_w

    def tells(self, continuous_w: float) -> bool:
        return self.responsivity_a_per_w * continuous_w >= self.alarm_a

    def clicks(self, pulses_w: Powers, continuous_w: float, random: np.random.Generator) -> Mask:
        """Return which bright pulses it clicks for; one that sees photons does so for all."""
        if not self.is_blind(continuous_w):
            return pulses_w > 0
        likely = (pulses_w - self.never_w) / (self.always_w - self.never_w)
        clicked: Mask = random.random(pulses_w.shape) < likely
        return clicked


@dataclass(frozen=True)
class ReflectingSource:
    """A source that sends back some of what is sent into it."""

    reflection_db: float = 60.0  # that its light loses from the entrance to the mirror and back
    isolator_db: float = 0.0  # more that it loses on its way in
    alarm_photons: float = inf  # a pulse at the entrance, at which its monitor tells; inf: none

    def tells(self, photons: float) -> bool:
        return photons >= self.alarm_photons

    def reflected(self, photons: float) -> float:
        return float(photons * 10 ** (-(self.reflection_db + self.isolator_db) / 10))


MONITORED = AvalanchePhotodiode(alarm_a=10e-6)  # a million clicks a second make some 1e-6 A
GUARDED = ReflectingSource(isolator_db=60.0, alarm_photons=1e8)
SIGMAS = 5


@dataclass(frozen=True)
class Glare:
    """Eve's light on each of bob's detectors."""

    continuous_w: float = 1.1e-3
    trigger_w: float = 1.1e-3  # peak of a pulse that all comes to one detector


def blinding(defended: bool, bits: int) -> tuple[int, int]:
    """Blind bob's detectors and let those click that eve's did; return bits known, of how many.

    The defence is a monitor of their photocurrent: what it tells of is not a key.
    """
    detector = MONITORED if defended else AvalanchePhotodiode()
    spied = asyncio.run(blinded(4 * bits, Glare(), detector))
    caught = detector.tells(Glare.continuous_w)
    share = 0.0 if caught else asymptotic_fraction(spied.qber) if defended else 1.0
    return spied.left(share * spied.bits), spied.bits


async def blinded(photons: int, glare: Glare, detector: AvalanchePhotodiode) -> Spied:
    """Return the key that alice and bob sift of `photons` photons, and eve's share of it."""
    laboratory = Laboratory(configuration(SEED, [fiber(*TO_EVE)]))
    alice, eve = laboratory.host("alice"), laboratory.host("eve")
    random, light = np.random.default_rng(SEED), (0, 0)
    states = random.integers(0, 4, photons, dtype=np.uint8)
    bases, hers = random.integers(0, 2, (2, photons), dtype=np.uint8)
    await alice.prepare(states, light[0])
    await alice.send({light: TO_EVE[0]})
    await eve.receive(light, TO_EVE[1])
    hers_seen: Any = await eve.measure(light, bases=hers)
    outcomes = seen(2 * hers + hers_seen, bases, glare, detector, random)
    sifted = (bases == states >> 1) & (outcomes != NO_CLICK)
    knows = sifted & (hers == bases) & (hers_seen == outcomes)
    wrong = sifted & (outcomes != states & 1)
    return Spied(int(sifted.sum()), int(knows.sum()), int(wrong.sum()))


def seen(
    states: Bytes,
    bases: Bytes,
    glare: Glare,
    detector: AvalanchePhotodiode,
    random: np.random.Generator,
) -> Bytes:
    """Return what two such detectors tell of bright pulses; a bit of both is drawn."""
    pulses_w = glare.trigger_w * shares(states, bases)
    zero, one = detector.clicks(pulses_w, glare.continuous_w, random).T
    coins = random.integers(0, 2, states.size, dtype=np.uint8)
    outcomes = np.where(zero & one, coins, one.astype(np.uint8))
    return np.where(zero | one, outcomes, np.uint8(NO_CLICK)).astype(np.uint8)


def trojan_light(defended: bool, bits: int) -> tuple[int, int]:
    """Read alice's modulator by reflected light; return bits known, of how many.

    The defence is an isolator, and a monitor that tells of more light than it was made for.
    """
    source = GUARDED if defended else ReflectingSource()
    return trojan(source, 1e7, bits, defended)


def trojan(
    source: ReflectingSource, injected: float, bits: int, amplified: bool
) -> tuple[int, int]:
    """Return how many bits eve knows by photons that she sends into a source, of how many.

    She keeps returning light until bases are announced: one photon in the right one is enough. The
    ends take away as many bits as light below the alarm can tell, and some standard errors.
    """
    random = np.random.default_rng(SEED)
    states = random.integers(0, 4, bits, dtype=np.uint8)
    mean = source.reflected(injected) * shares(states, states >> np.uint8(1))
    photons = random.poisson(mean)
    assert not photons[np.arange(bits), 1 - (states & 1)].any()  # none in the other arm
    spied = Spied(bits, int((photons.sum(axis=1) > 0).sum()), 0)
    if not amplified:
        return spied.known, bits
    if source.tells(injected):
        return 0, bits
    leak = 1 - exp(-source.reflected(source.alarm_photons))
    length = bits * (1 - leak) - SIGMAS * sqrt(bits * leak * (1 - leak))
    return spied.left(length), bits
