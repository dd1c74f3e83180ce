"""A station in the middle that heralds pairs of memories which emit: how many, and how good."""

import math
from typing import Any

import numpy as np

from dispatcher.laboratory import Laboratory
from evidence.curves import theory
from evidence.curves.estimates import Estimate, proportion
from evidence.curves.experiment import Experiment, Measure, Outcome, number, pairs_parameter
from evidence.curves.link import configuration, fiber
from evidence.curves.parameters import Parameter, Values
from wire.parameters.physics import BellAnalyser, Device, Emitter

SCHEME = Parameter("scheme", "two-click", choices=("two-click", "single-click"))
KM = Parameter("arm_km", 10.0, 0.001, 500.0, "km")
LOSS = Parameter("loss_db_per_km", 0.2, 0.0, 10.0, "dB/km")
EFFICIENCY = Parameter("efficiency", 0.1, 1e-6, 1.0)
BRIGHT = Parameter("bright_state", 0.1, 0.0, 1.0)
VISIBILITY = Parameter("visibility", 0.9, 0.0, 1.0)

WAYS = {"alice": ("alice-q0", "charlie-q0"), "bob": ("bob-q0", "charlie-q1")}
MAX_S = 60.0
ROUNDS = 1_000  # of attempts that all pairs take, about: modes are as many as that needs
MAX_MODES = 1_000_000
PSI_MINUS = 3


async def herald(values: Values, seed: int) -> Outcome:
    """Herald pairs, and measure each in one basis at both ends."""
    chance, count = _heralds(values)[0], int(values["pairs"])
    emitter = Emitter(
        str(values[SCHEME.name]),
        number(values, EFFICIENCY.name),
        number(values, BRIGHT.name),
        modes=min(max(int(count / chance / ROUNDS), 1), MAX_MODES),
    )
    lengths: dict[str, Any] = {
        "length_km": number(values, KM.name),
        "loss_db_per_km": number(values, LOSS.name),
    }
    fibers = [fiber(*way, **lengths) for way in WAYS.values()]
    analyser = BellAnalyser("linear", visibility=number(values, VISIBILITY.name))
    devices = dict.fromkeys(WAYS, Device(emitter=emitter)) | {"charlie": Device(analyser=analyser)}
    laboratory = Laboratory(configuration(seed, fibers, devices))
    for half, (host, (port, _far)) in enumerate(WAYS.items()):
        await laboratory.host(host).attempt((0, half), port)
    found = await laboratory.host("charlie").herald(count, ("charlie-q0", "charlie-q1"), MAX_S)
    heralds = np.frombuffer(found.outcomes, np.uint8)
    each = proportion(heralds.size, found.attempts)
    per_s = found.attempts / emitter.modes / ((found.last_ns - found.first_ns) / 1e9)
    rate = Estimate(each.value * per_s, each.error * per_s)
    return {"rate": rate, "fidelity": await _fidelity(laboratory, heralds)}


async def _fidelity(laboratory: Laboratory, heralds: np.ndarray) -> Estimate:
    """Return the fidelity to the heralded Bell state, from a third of the pairs in each basis."""
    bases = (np.arange(heralds.size) % 3).astype(np.uint8)
    mine, yours = [
        await laboratory.host(host).measure((0, half), bases=bases)
        for half, host in enumerate(WAYS)
    ]
    differ = np.where(bases == 0, 1, heralds == PSI_MINUS)  # Psi+ is alike in X and Y, not in Z
    right = (mine ^ yours) == differ
    shares = [proportion(int(right[bases == b].sum()), int((bases == b).sum())) for b in range(3)]
    value = (1 + sum(2 * share.value - 1 for share in shares)) / 4
    return Estimate(value, math.hypot(*(share.error for share in shares)) / 2)


def _heralds(values: Values) -> tuple[float, float]:
    """Return the theory of an attempt: how likely a herald is, and the fidelity it tells of."""
    loss_db = number(values, LOSS.name) * number(values, KM.name)
    light = number(values, EFFICIENCY.name) * theory.transmission(loss_db)
    visibility = number(values, VISIBILITY.name)
    if values[SCHEME.name] == "two-click":
        return theory.two_clicks(light, visibility)
    return theory.single_click(light, number(values, BRIGHT.name), visibility)


def rate(values: Values) -> float:
    """Return p c / 2L of one mode, L the way to the station."""
    return _heralds(values)[0] / (2 * fiber(*WAYS["alice"], length_km=values[KM.name]).delay_s)


HERALDING = Experiment(
    "heralding",
    "pairs of memories that emit, heralded by a station in the middle",
    (SCHEME, KM, LOSS, EFFICIENCY, BRIGHT, VISIBILITY, pairs_parameter()),
    (
        Measure("rate", "pairs a second of one mode (1/s)", rate, logarithmic=True),
        Measure(
            "fidelity", "fidelity to the heralded Bell state", lambda values: _heralds(values)[1]
        ),
    ),
    herald,
)
