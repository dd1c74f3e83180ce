"""BB84 with a weak laser and an eavesdropper who splits photon numbers, or does nothing.

    alice === eve === bob          what alice and bob take for loss is what eve makes of it

She keeps a photon of each pulse of several, sends on only as many pulses as are expected, and
measures hers when the bases are announced (Brassard, Luetkenhaus, Mor, Sanders 2000).
"""

import numpy as np

from dispatcher.laboratory import Laboratory, LaboratoryHost
from dispatcher.sabot.backend import Bytes
from evidence.curves import prepared_states, theory
from evidence.curves.decoy_states import key
from evidence.curves.estimates import Estimate, proportion
from evidence.curves.experiment import Experiment, Measure, Outcome, number, pairs_parameter
from evidence.curves.link import configuration, fiber
from evidence.curves.multi_pair import LOSS
from evidence.curves.parameters import Parameter, Values
from evidence.curves.prepared_states import Block, Counts, Exchange
from hosts.middleware.qkd.decoy import LEVELS, SHARES, Decoys
from hosts.middleware.services.interception.attacks import SEVERAL, Way
from wire.parameters.physics import Device, PairSource

MEAN = Parameter("mean_photons", 0.5, 0.2, 1.0)
EVE = Parameter("eve", "on", choices=("off", "on"))
DECOYS = Parameter("decoys", "off", choices=("off", "on"))
WEAK, CORRECTION = 0.1, 1.16  # as in evidence.curves.decoy_states
TO_EVE, TO_BOB = ("alice-q0", "eve-q0"), ("eve-q1", "bob-q0")
KEPT, TRASH = 1 << 31, 3 << 30  # numbers of eve's blocks, beside that of the light
NO_LEVELS = (1.0, 0.0, 0.0)


async def send(values: Values, seed: int) -> Outcome:
    means = means_of(values)
    found, known = await exchange(values, seed)
    gain, decoys = found.gain(), values[DECOYS.name] == "on"
    pulses = int(found.sent.sum())
    return {
        "gain": gain,
        "weak": found.gain(1),
        "qber": found.qber,
        "known": proportion(int(known.sum()), int(found.counts.sum())),
        "key": key(Decoys(means), found.counts, pulses) if decoys else gllp(gain, means[0]),
    }


async def exchange(values: Values, seed: int) -> tuple[Exchange, Counts]:
    """Send pulses past eve; return the counts, and of the sifted those that eve knows, by basis."""
    laboratory, random = scene(values, seed), np.random.default_rng(seed)
    eve, known = laboratory.host("eve"), np.zeros(2, np.int64)
    way = Way(number(values, LOSS.name)) if values[EVE.name] == "on" else None

    async def forward(number: int) -> None:
        await eve.receive((number, 0), TO_EVE[1])
        if way is not None:
            await attack(eve, number, way, random)
        await eve.send({(number, 0): TO_BOB[0]})

    async def listen(number: int, block: Block) -> None:
        if way is not None:  # the bases are public when all is measured
            same, states = block.sifted, block.states
            hers = await eve.measure((number | KEPT, 0), bases=states >> np.uint8(1))
            agree = hers[same] == states[same] & np.uint8(1)
            known[:] += np.bincount(block.bases[same][agree], minlength=2)

    pulses, path = int(values["pairs"]), (TO_EVE[0], TO_BOB[1])
    shares = shares_of(values)
    found = await prepared_states.exchange(
        laboratory, pulses, random, shares, path, forward, listen
    )
    return found, known


async def attack(eve: LaboratoryHost, block: int, way: Way, random: np.random.Generator) -> None:
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
