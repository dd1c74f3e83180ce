"""The Hong-Ou-Mandel dip: how often photons that come apart by tau show no interference.

Phi+ is measured by an analyser without a delay line, behind fibres of which one is longer by c tau:
distinguishable photons give the wrong phase, with the probability of a coincidence in a
Hong-Ou-Mandel interferometer.
"""

import numpy as np

from dispatcher.laboratory import Laboratory
from evidence.curves import theory
from evidence.curves.estimates import proportion
from evidence.curves.experiment import Experiment, Measure, Outcome, number, pairs_parameter
from evidence.curves.link import PLAIN, TESTED, configuration, fiber
from evidence.curves.parameters import Parameter, Values
from evidence.curves.superdense import blocks, transmit
from wire.parameters.physics import BellAnalyser, Device, PairSource

PS_PER_S = 1e12
DELAY = Parameter("delay_ps", 0.0, -1e6, 1e6, "ps")
VISIBILITY = Parameter("visibility", 1.0)
BANDWIDTH = Parameter("bandwidth_rad_per_s", 1e12, 0.0, 1e15, "rad/s")
SOURCE = Parameter("bandwidth_nm", 0.0, 0.0, 100.0, "nm")  # instead, if there is no filter
DISPERSION = Parameter("dispersion_ps_per_nm", 0.0, -1e3, 1e3, "ps/nm")  # of one half alone
LENGTH_KM = 2.0
WRONG_PHASE = 2


async def dip(values: Values, seed: int) -> Outcome:
    """Count how often Phi+ is taken for Phi-."""
    later_km = number(values, DELAY.name) / PS_PER_S * theory.SPEED_IN_FIBER_M_PER_S / 1e3
    length_km = LENGTH_KM + later_km
    dispersion = number(values, DISPERSION.name) / length_km
    tested = fiber(*TESTED, length_km=length_km, dispersion_ps_per_nm_km=dispersion)
    fibers = [tested, fiber(*PLAIN, length_km=LENGTH_KM)]
    analyser = BellAnalyser(
        visibility=number(values, VISIBILITY.name),
        bandwidth_rad_per_s=number(values, BANDWIDTH.name),
        delay_line_km=0.0,
    )
    source = PairSource(bandwidth_nm=number(values, SOURCE.name))
    devices = {"alice": Device(source), "bob": Device(analyser=analyser)}
    laboratory = Laboratory(configuration(seed, fibers, devices))
    alice, bob = laboratory.host("alice"), laboratory.host("bob")
    wrong = pairs = 0
    for block, size in enumerate(blocks(int(values["pairs"]))):
        received = await transmit(alice, bob, block, np.zeros(size, np.uint8))
        wrong += int(np.count_nonzero(received == WRONG_PHASE))
        pairs += size
    return {"coincidences": proportion(wrong, pairs)}


def coincidences(values: Values) -> float:
    delay_s = number(values, DELAY.name) / PS_PER_S
    width = number(values, BANDWIDTH.name) or theory.rad_per_s(number(values, SOURCE.name))
    chirp_s2 = number(values, DISPERSION.name) / PS_PER_S / theory.rad_per_s(1.0)
    return theory.coincidences(delay_s, number(values, VISIBILITY.name), width, chirp_s2)


HOM = Experiment(
    "hom",
    "Hong-Ou-Mandel interference of photons that come apart",
    (DELAY, VISIBILITY, BANDWIDTH, SOURCE, DISPERSION, pairs_parameter()),
    (Measure("coincidences", "coincidence probability", coincidences),),
    dip,
)
