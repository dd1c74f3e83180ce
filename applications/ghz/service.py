"""GHZ states, as every process knows them, and what all services of a line of hosts have."""

from wire.features import ABSORB, EMIT, MEASURE, STORE
from wire.light import ACCEPTOR, OPENER, TO_NEXT, RegisteredService
from wire.results.figures import Figures

NEEDS_OF_LINE = {OPENER: EMIT | STORE | MEASURE, ACCEPTOR: ABSORB | STORE | MEASURE}


class LineFigures(Figures):
    """Of the leader of a line of hosts, whatever its states are for."""

    states: int  # with outcomes
    hosts: int
    made: int
    emitted: int  # pairs of its own
    states_per_s: float
    elapsed_s: float


class FollowerFigures(Figures):
    """Of a host of the line that another has asked."""

    states: int
    fused: int


class GhzFigures(LineFigures):
    """Of GHZ states, at their leader."""

    fidelity: float | None
    fidelity_error: float | None  # standard error
    equal_in_z: float | None
    coherence: float | None


GHZ = RegisteredService(
    name="ghz",
    number=11,
    title="GHZ states",
    light=TO_NEXT,
    needs=NEEDS_OF_LINE,
    ends="applications.ghz.ends:KIND",
    figures=(LineFigures, FollowerFigures, GhzFigures),
    line=True,
)
