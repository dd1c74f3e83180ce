"""Photons in a fibre that carries classical light, too: how often they are seen, and wrongly."""

from math import exp
from typing import Any

import numpy as np

from dispatcher.laboratory import Laboratory
from evidence.curves import theory
from evidence.curves.estimates import proportion
from evidence.curves.experiment import Experiment, Measure, Outcome, number, pairs_parameter
from evidence.curves.link import TESTED, configuration, fiber
from evidence.curves.parameters import Parameter, Values
from evidence.curves.superdense import blocks
from wire.dispatcher_pb2 import CreateRequest
from wire.outcomes import NO_CLICK

FIBER = (
    Parameter("length_km", 20.0, 0.0, 1_000.0, "km"),
    Parameter("loss_db_per_km", 0.33, 0.0, 100.0, "dB/km"),
    Parameter("classical_mw", 1.0, 0.0, 1_000.0, "mW"),
    Parameter("classical_db_per_km", 0.2, 0.0, 100.0, "dB/km"),
    Parameter("classical_way", "along", choices=("along", "against")),
    Parameter("raman_per_km_nm", 2e-9, 0.0, 1e-3, "1/(km nm)"),
    Parameter("filter_nm", 0.4, 0.0, 100.0, "nm"),
    Parameter("filter_center_nm", 1550.12, 200.0, 5_000.0, "nm"),
    Parameter("pulse_window_s", 1e-9, 0.0, 1e-3, "s"),
)


async def look(values: Values, seed: int) -> Outcome:
    """Send photons in |0>, and measure each in Z."""
    given: dict[str, Any] = {each.name: values[each.name] for each in FIBER}
    way = fiber(*TESTED, **given)
    laboratory = Laboratory(configuration(seed, [way]))
    alice, bob = laboratory.host("alice"), laboratory.host("bob")
    pulses = seen = wrong = 0
    for block, size in enumerate(blocks(int(values["pairs"]))):
        await alice.create(size, block, CreateRequest.ZEROS)
        await alice.send({(block, 0): TESTED[0]})
        pulses += size
        if await bob.receive((block, 0), TESTED[1]) is None:
            continue
        bits = await bob.measure((block, 0))
        seen += int(np.count_nonzero(bits != NO_CLICK))
        wrong += int(np.count_nonzero(bits == 1))
    return {"gain": proportion(seen, pulses), "qber": proportion(wrong, seen)}


def expected(values: Values) -> tuple[float, float]:
    """Return what theory says of pulses seen, and of their error rate."""
    given = {each.name: values[each.name] for each in FIBER if not each.choices}
    against = values["classical_way"] == "against"
    noise = theory.scattered_photons(**{k: float(v) for k, v in given.items()}, against=against)
    arrives = theory.transmission(number(values, "loss_db_per_km") * number(values, "length_km"))
    dark = exp(-noise / 2)  # in either detector
    seen = 1 - (1 - arrives) * dark**2
    both = (1 - dark) * (1 - (1 - arrives) * dark)
    return seen, ((1 - arrives) * dark * (1 - dark) + both / 2) / seen


CLASSICAL_LIGHT = Experiment(
    "classical-light",
    "photons beside classical light, by what it scatters",
    (*FIBER, pairs_parameter(1_000_000)),
    (
        Measure("gain", "pulses seen", lambda values: expected(values)[0]),
        Measure("qber", "error rate (QBER)", lambda values: expected(values)[1]),
    ),
    look,
)
