"""BB84 with a weak laser: how often its pulses are seen, and the key that leaves without decoys."""

import numpy as np

from dispatcher.laboratory import Laboratory
from evidence.curves import theory
from evidence.curves.estimates import Estimate
from evidence.curves.experiment import Experiment, Measure, Outcome, number, pairs_parameter
from evidence.curves.link import TESTED, configuration, fiber
from evidence.curves.multi_pair import LOSS
from evidence.curves.parameters import Parameter, Values
from evidence.curves.prepared_states import exchange
from hosts.middleware.qkd.key_length import asymptotic_fraction
from wire.parameters.physics import Device, PairSource

MEAN = Parameter("mean_photons", 0.1, 0.0, 10.0)


async def send(values: Values, seed: int) -> Outcome:
    source = PairSource(statistics="poisson", mean_pairs=number(values, MEAN.name))
    way = fiber(*TESTED, connectors_db=number(values, LOSS.name))
    laboratory = Laboratory(configuration(seed, [way], {"alice": Device(source=source)}))
    found = await exchange(laboratory, int(values["pairs"]), np.random.default_rng(seed))
    gain, (sifted, wrong) = found.gain(), (found.counts.sum(), found.counts[:, 1].sum())
    qber = float(wrong / sifted) if sifted else 0.0
    single = 1 - source.multi_photon / gain.value if gain.value else 0.0
    key = gain.value / 2 * asymptotic_fraction(qber, single)
    return {"gain": gain, "key": Estimate(key, gain.error)}


def _mean_seen(values: Values) -> float:
    return number(values, MEAN.name) * theory.transmission(number(values, LOSS.name))


WEAK_PULSES = Experiment(
    "weak-pulses",
    "BB84 with a weak laser and without decoys",
    (MEAN, LOSS, pairs_parameter(1_000_000)),
    (
        Measure("gain", "pulses seen", lambda values: theory.gain(_mean_seen(values))),
        Measure(
            "key",
            "secret bits per pulse",
            lambda values: theory.key_without_decoys(number(values, MEAN.name), _mean_seen(values)),
        ),
    ),
    send,
)
