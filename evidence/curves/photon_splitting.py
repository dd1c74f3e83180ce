"""BB84 with a weak laser and an eavesdropper who splits photon numbers, or does nothing.

    alice === eve === bob          what alice and bob take for loss is what eve makes of it

She keeps a photon of each pulse of several, sends on only as many pulses as are expected, and
measures hers when the bases are told (Brassard, Luetkenhaus, Mor, Sanders 2000).
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dispatcher.laboratory import Laboratory, LaboratoryHost
from dispatcher.sabot.backend import Bytes
from evidence.curves import theory
from evidence.curves.decoy_states import key
from evidence.curves.estimates import Estimate, proportion
from evidence.curves.experiment import Experiment, Measure, Outcome, number, pairs_parameter
from evidence.curves.link import configuration, fiber
from evidence.curves.multi_pair import LOSS
from evidence.curves.parameters import Parameter, Values
from evidence.curves.superdense import blocks
from hosts.middleware.qkd.decoy import LEVELS, SHARES, Decoys
from hosts.middleware.services.interception.attacks import SEVERAL, Way
from wire.outcomes import NO_CLICK
from wire.parameters.physics import Device, PairSource

MEAN = Parameter("mean_photons", 0.5, 0.2, 1.0)
EVE = Parameter("eve", "on", choices=("off", "on"))
DECOYS = Parameter("decoys", "off", choices=("off", "on"))
WEAK, CORRECTION = 0.1, 1.16  # as in evidence.curves.decoy_states
TO_EVE, TO_BOB = ("alice-q0", "eve-q0"), ("eve-q1", "bob-q0")
KEPT, TRASH = 1 << 31, 3 << 30  # numbers of eve's blocks, beside that of the light
NO_LEVELS = (1.0, 0.0, 0.0)


class Exchange(NamedTuple):
    """What became of pulses; arrays end with the level of their intensity."""

    sent: NDArray[np.int64]
    seen: NDArray[np.int64]
    counts: NDArray[np.int64]  # sifted, by basis and by whether they are wrong
    known: NDArray[np.int64]  # of these, to eve; by basis


async def send(values: Values, seed: int) -> Outcome:
    """Send pulses past eve, and compare what bob and she have found with what was sent."""
    means = means_of(values)
    sent, seen, counts, known = await exchange(values, seed)
    signal = counts[:, :, 0].sum(axis=0)
    gain = proportion(int(seen[0]), int(sent[0]))
    decoys = values[DECOYS.name] == "on"
    return {
        "gain": gain,
        "weak": proportion(int(seen[1]), int(sent[1])),
        "qber": proportion(int(signal[1]), int(signal.sum())),
        "known": proportion(int(known.sum()), int(counts.sum())),
        "key": key(Decoys(means), counts, int(sent.sum())) if decoys else gllp(gain, means[0]),
    }


async def exchange(values: Values, seed: int) -> Exchange:
    """Send pulses past eve, and count what bob and she have found of what was sent."""
    shares = shares_of(values)
    laboratory = scene(values, seed)
    alice, eve, bob = (laboratory.host(name) for name in ("alice", "eve", "bob"))
    way = Way(number(values, LOSS.name)) if values[EVE.name] == "on" else None
    random = np.random.default_rng(seed)
    sent, seen = np.zeros(LEVELS, np.int64), np.zeros(LEVELS, np.int64)
    counts, known = np.zeros((2, 2, LEVELS), np.int64), np.zeros(2, np.int64)
    for block, size in enumerate(blocks(int(values["pairs"]))):
        states, bases = random.integers(0, (4, 2), (size, 2), dtype=np.uint8).T.copy()
        levels = random.choice(LEVELS, size, p=shares).astype(np.uint8)
        await alice.prepare(states, block, levels)
        await alice.send({(block, 0): TO_EVE[0]})
        await eve.receive((block, 0), TO_EVE[1])
        if way is not None:
            await attack(eve, block, way, random)
        await eve.send({(block, 0): TO_BOB[0]})
        none = np.full(size, NO_CLICK, np.uint8)
        came = await bob.receive((block, 0), TO_BOB[1])
        bits = none if came is None else await bob.measure((block, 0), bases=bases)
        told = states >> 1  # the bases, when all is measured
        hers = none if way is None else await eve.measure((block | KEPT, 0), bases=told)
        clicked = bits != NO_CLICK
        sent += np.bincount(levels, minlength=LEVELS)
        seen += np.bincount(levels[clicked], minlength=LEVELS)
        same = clicked & (bases == told)
        right = states[same] & np.uint8(1)
        np.add.at(counts, (bases[same], bits[same] ^ right, levels[same]), 1)
        known += np.bincount(bases[same][hers[same] == right], minlength=2)
    return Exchange(sent, seen, counts, known)


async def attack(eve: LaboratoryHost, block: int, way: Way, random: np.random.Generator) -> None:
    """Keep one photon of several, and send on what both ends expect."""
    light = (block, 0)
    photons: Bytes = await eve.split(light, (block | KEPT, 0))
    shares = np.array(way.sent_on(np.bincount(photons).tolist()))
    chances = shares[(photons >= SEVERAL).astype(int)]
    back = np.flatnonzero((photons > 0) & (random.random(photons.size) >= chances))
    if back.size:
        await eve.gather((block | TRASH, 0), {light: back}, keep_rest=True)
        await eve.discard((block | TRASH, 0))


def scene(values: Values, seed: int) -> Laboratory:
    """Return the three hosts; what eve does not do, the fibre behind her does."""
    spied, mean = values[EVE.name] == "on", number(values, MEAN.name)
    loss_db = 0.0 if spied else number(values, LOSS.name)
    fibers = [fiber(*TO_EVE), fiber(*TO_BOB, connectors_db=loss_db)]
    laser = Device(PairSource("poisson", mean, decoys=means_of(values)[1:]))
    return Laboratory(configuration(seed, fibers, {"alice": laser}))


def gllp(gain: Estimate, mean: float) -> Estimate:
    """Return the secret bits of a pulse without errors, of long keys (quant-ph/0212066)."""
    tagged = PairSource("poisson", mean).multi_photon
    return Estimate(max(0.0, gain.value - tagged) / 2, gain.error / 2)


def means_of(values: Values) -> tuple[float, ...]:
    return number(values, MEAN.name), WEAK, 0.0


def shares_of(values: Values) -> tuple[float, ...]:
    return SHARES if values[DECOYS.name] == "on" else NO_LEVELS


def _seen(values: Values, level: int) -> float:
    means, t = means_of(values), theory.transmission(number(values, LOSS.name))
    if values[EVE.name] == "off":
        return theory.gain(means[level] * t)
    single, several = theory.sent_on(means, shares_of(values), t)
    mean = means[level]
    return single * theory.poisson(mean, 1) + several * theory.several_photons(mean)


def _known(values: Values) -> float:
    """Return of how many sifted bits eve has a photon, in theory."""
    if values[EVE.name] == "off":
        return 0.0
    means, shares = means_of(values), shares_of(values)
    _single, sent = theory.sent_on(means, shares, theory.transmission(number(values, LOSS.name)))
    pairs = list(zip(shares, means, strict=True))
    several = sent * sum(share * theory.several_photons(mean) for share, mean in pairs)
    return several / sum(share * _seen(values, i) for i, (share, _mean) in enumerate(pairs))


def _key(values: Values) -> float:
    means, seen = means_of(values), [_seen(values, level) for level in range(LEVELS)]
    if values[DECOYS.name] == "off":
        return max(0.0, seen[0] - theory.several_photons(means[0])) / 2
    return theory.decoy_key(means, SHARES, [(gain, 0.0) for gain in seen], CORRECTION)


PHOTON_SPLITTING = Experiment(
    "photon-splitting",
    "BB84 with a weak laser and an eavesdropper who splits photon numbers",
    (LOSS, MEAN, EVE, DECOYS, pairs_parameter(1_000_000)),
    (
        Measure("gain", "signal pulses seen", lambda values: _seen(values, 0)),
        Measure("weak", "weak pulses seen", lambda values: _seen(values, 1)),
        Measure("qber", "errors of the signal", lambda _values: 0.0),
        Measure("known", "sifted bits that eve knows", _known),
        Measure("key", "secret bits per pulse", _key),
    ),
    send,
)
