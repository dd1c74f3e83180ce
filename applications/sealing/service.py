"""Tamper seals, which are the link monitors of the controller, as every process knows them."""

from wire.features import EMIT, MEASURE
from wire.light import ACCEPTOR, OPENER, PAIRS, SOURCE, TO_NEXT, RegisteredService
from wire.results.figures import SealedFigures, SealFigures

SEAL = RegisteredService(
    name="seal",
    number=10,
    title="Tamper seal",
    light=PAIRS,
    needs={SOURCE: EMIT, OPENER: MEASURE, ACCEPTOR: MEASURE},
    own_light=TO_NEXT,
    ends="applications.sealing.seal:KIND",
    figures=(SealFigures, SealedFigures),
    monitors=True,
)
