"""Options of graph states."""

from dataclasses import dataclass

from hosts.middleware.services.ghz.options import GhzOptions
from hosts.middleware.services.graph_states.graph import NAMED, Graph, read_graph
from hosts.middleware.session.errors import SessionError
from hosts.middleware.session.options import check_choice
from wire.metadata.vocabulary import Reason

SHAPES = tuple(NAMED)
STABILISERS, COLOURS = WITNESSES = ("stabilisers", "colours")


@dataclass(frozen=True)
class GraphOptions(GhzOptions):
    """`count` graph states of all hosts, measured to tell how good they are."""

    graph: str = "line"  # a name of SHAPES, or edges as A-B,B-C
    hub: str = ""  # a host that fuses pairs, and is measured out; "": none
    witness: str = STABILISERS

    @property
    def edges(self) -> Graph:
        """Return the graph; raise SessionError where there is none of all hosts of the line."""
        try:
            return read_graph(self.graph, self.names, self.hub)
        except ValueError as error:
            raise SessionError(Reason.UNSUPPORTED, f"graph {self.graph}: {error}") from error

    def check(self) -> None:
        """Raise SessionError for a value out of range."""
        super().check()
        check_choice("witness", self.witness, WITNESSES)
        if not isinstance(self.graph, str):
            text = f"graph {self.graph!r}: write {', '.join(SHAPES)}, or edges as A-B,B-C"
            raise SessionError(Reason.UNSUPPORTED, text)
        if not isinstance(self.hub, str):
            raise SessionError(Reason.UNSUPPORTED, f"hub {self.hub!r} is not a name")
        try:
            self.edges.left()
        except ValueError as error:
            text = f"graph {self.graph} without {self.hub}: {error}"
            raise SessionError(Reason.UNSUPPORTED, text) from error
