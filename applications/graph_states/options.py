"""Options of graph states."""

from dataclasses import dataclass

from applications.ghz.options import GhzOptions
from applications.graph_states.graph import NAMED, Graph, read_graph
from hosts.middleware.session.errors import unsupported
from wire.parameters.option import option

SHAPES = tuple(NAMED)
STABILISERS, COLOURS = WITNESSES = ("stabilisers", "colours")


@dataclass(frozen=True)
class GraphOptions(GhzOptions):
    """`count` graph states of all hosts, measured to tell how good they are."""

    graph: str = option(
        "line",
        f"{', '.join(SHAPES)} (of the first host with all others), or edges",
        metavar="NAME|A-B,B-C",
    )
    hub: str = option(
        "",
        "a host of the line that fuses pairs, and is measured out: it joins its neighbours (none)",
        metavar="HOST",
    )
    witness: str = option(
        STABILISERS,
        "the fidelity by stabilisers drawn of all, or a bound of it by a few settings, as many as "
        f"the graph has colours ({STABILISERS})",
        choices=WITNESSES,
    )

    @property
    def edges(self) -> Graph:
        """Return the graph; raise SessionError where there is none of all hosts of the line."""
        try:
            return read_graph(self.graph, self.names, self.hub)
        except ValueError as error:
            raise unsupported(f"graph {self.graph}: {error}") from error

    def check(self) -> None:
        super().check()
        if not isinstance(self.graph, str):
            text = f"graph {self.graph!r}: write {', '.join(SHAPES)}, or edges as A-B,B-C"
            raise unsupported(text)
        if not isinstance(self.hub, str):
            raise unsupported(f"hub {self.hub!r} is not a name")
        try:
            self.edges.left()
        except ValueError as error:
            raise unsupported(f"graph {self.graph} without {self.hub}: {error}") from error
