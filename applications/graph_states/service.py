"""Graph states, as every process knows them."""

from applications.ghz.service import NEEDS_OF_LINE, LineFigures
from wire.light import TO_NEXT, RegisteredService


class GraphFigures(LineFigures):
    """Of graph states, at their leader; either the fidelity, or a bound of it."""

    fidelity: float | None = None
    fidelity_at_least: float | None = None
    fidelity_error: float | None  # standard error
    passed: list[float] | None = None  # of each colour
    edges: int
    pairs_per_state: int


GRAPH = RegisteredService(
    name="graph",
    number=16,
    title="Graph states",
    light=TO_NEXT,
    needs=NEEDS_OF_LINE,
    ends="applications.graph_states.ends:KIND",
    figures=(GraphFigures,),
    line=True,
)
