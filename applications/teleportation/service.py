"""Teleportation, as every process knows it."""

from wire.features import ABSORB, EMIT, MEASURE, STORE
from wire.light import ACCEPTOR, OPENER, PAIRS, SOURCE, TO_NEXT, RegisteredService
from wire.results.figures import TeleportFigures

KEEPS = ABSORB | STORE | MEASURE
TELEPORT = RegisteredService(
    name="teleport",
    number=4,
    title="Teleportation",
    light=PAIRS,
    own_light=TO_NEXT,
    needs={SOURCE: EMIT, OPENER: KEEPS, ACCEPTOR: KEEPS},
    ends="applications.teleportation.teleport:KIND",
    figures=(TeleportFigures,),
    joins=frozenset({OPENER}),
)
