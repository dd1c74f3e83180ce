"""The protocol of graph states at all hosts of a line: no socket, no clock.

leader                      next                        last
  | (ghz/line.py)              |                          |
  | Values(EDGES) -----------> | Values(EDGES) ---------> |  the graph
  | Values(COMING) ----------> | Values(COMING) --------> |  and so on, as of GHZ states: pairs,
  |                            |                          |  in as many layers as the graph has
  |            swaps, H, CX, all halves but one measured  |
  | Values(CORRECTIONS) -----> | Values(CORRECTIONS) ---> |  bits for those behind: Z
  | <------- Values(OUTCOMES)  | <---- Values(OUTCOMES)   |  bits for those before: Z
  | Values(BASES) -----------> | Values(BASES) ---------> |
  | <------- Values(OUTCOMES)  | <---- Values(OUTCOMES)   |
"""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from applications.ghz import protocol
from applications.ghz.line import Table
from applications.graph_states.fusion import Fusion, combined, lit
from applications.graph_states.graph import graph_of_numbers, numbers_of_graph
from applications.graph_states.options import COLOURS, GraphOptions
from applications.graph_states.service import GraphFigures
from applications.graph_states.witness import Colours, Stabilisers
from hosts.hardware.block_name import BlockName
from hosts.hardware.replies import Symbols
from hosts.middleware.session.blocks import LOST
from hosts.middleware.session.errors import SessionError
from hosts.middleware.session.protocol import Steps, coming, hear
from hosts.middleware.session.values import numbers_of
from hosts.timeouts import BITS_TIMEOUT_S
from wire.metadata.values import Topic, Values
from wire.metadata.vocabulary import Reason


@dataclass
class Leader(protocol.Leader):
    """The host that asks: it draws what is measured."""

    options: GraphOptions
    kind = GraphFigures
    tally: Stabilisers | Colours = field(init=False)

    def __post_init__(self) -> None:
        """Make blocks as small as the halves of their states need."""
        graph = self.options.edges
        self.fusion = Fusion(graph, 0, self.side, self.right)
        witness = Colours if self.options.witness == COLOURS else Stabilisers
        self.tally = witness(graph.left())
        # Hosts between two others have reported room for two halves a state.
        halves_kept = [1, *[2] * (graph.hosts - 2), 1]
        needed = max(graph.kept(place) / halves for place, halves in enumerate(halves_kept))
        self.most = max(1, int(self.most / needed))

    def run(self) -> Steps[None]:
        numbers = numbers_of_graph(self.fusion.graph)
        yield from self.right.tell(self.side.say(Topic.EDGES, 0, numbers, 8))
        yield from super().run()

    def qubits(self, number: int) -> BlockName:
        return self.fusion.qubits(number)

    def bases(self, states: int) -> Table:
        graph = self.fusion.graph
        bases = np.zeros((graph.hosts, states), dtype=np.uint8)  # of a hub, too, which has measured
        bases[graph.members] = self.tally.bases(self.side.draws, states)
        return bases

    def count(self, bases: Table, outcomes: Table) -> None:
        members = self.fusion.graph.members
        super().count(bases[members], outcomes[members])

    def block(self, number: int, size: int) -> Steps[None]:
        fusion, graph = self.fusion, self.fusion.graph
        self.emitted += size
        for layer in range(len(graph.layers)):
            _, here = lit(graph, layer, 0)
            there = yield from self.pairs(fusion.number(number, layer), size, here)
            size = yield from fusion.keep(number, layer, there)
            if not size:
                return
        fused = yield from fusion.fuse(number, size)
        others = fused[1:].ravel()
        answers = yield from self.right.ask(Topic.CORRECTIONS, number, others, 2, (1, size))
        if states := (yield from fusion.correct(number, combined(fused[0], answers[0]))):
            self.made += states
            yield from self.use(number, states)

    def figures(self) -> dict[str, Any]:
        graph = self.fusion.graph
        return {
            **super().figures(),
            "edges": len(graph.left().edges),
            "pairs_per_state": graph.pairs,
        }


@dataclass
class Follower(protocol.Follower):
    fusion: Fusion | None = None  # known once the graph is
    expected: tuple[int, int, int] | None = None  # behind the first layer: number, layer, size

    def heard(self, message: Values) -> Steps[None]:
        if self.fusion is None:
            yield from self._introduced(message)
            return
        yield from self._layer(self.fusion, *coming(message, self.side.setup.pairs))

    def _introduced(self, message: Values) -> Steps[None]:
        if message.topic != Topic.EDGES or message.count < 2:
            raise SessionError(Reason.PROTOCOL, "a graph state does not begin so")
        numbers = numbers_of(message).tolist()
        try:
            graph = graph_of_numbers(numbers)
        except ValueError as error:
            raise SessionError(Reason.PROTOCOL, f"no graph of hosts: {error}") from error
        place = graph.hosts - 1 - self.behind
        if place < 1:
            text = f"a graph of {graph.hosts} hosts, with {self.behind} behind this one"
            raise SessionError(Reason.PROTOCOL, text)
        self.fusion = Fusion(graph, place, self.side, self.right)
        if self.right is not None:
            yield from self.right.tell(self.right.side.say(Topic.EDGES, 0, numbers, 8))

    def qubits(self, number: int) -> BlockName:
        assert self.fusion is not None
        return self.fusion.qubits(number)

    def outcomes(self, number: int, bases: Symbols) -> Steps[Symbols]:
        """Measure this host's qubits of states; a hub has none left."""
        if self.fusion is not None and self.fusion.is_hub:
            return np.zeros_like(bases)
        return (yield from super().outcomes(number, bases))

    def _layer(self, fusion: Fusion, number: int, size: int) -> Steps[None]:
        layers = len(fusion.graph.layers)
        state, layer = divmod(number, layers)
        due = (state, 0, size) if self.expected is None else self.expected
        if (state, layer, size) != due:
            text = f"layer {layer} of block {state}, {size} states, where {due} were due"
            raise SessionError(Reason.PROTOCOL, text)
        there = yield from self.pairs(number, size, *lit(fusion.graph, layer, fusion.place))
        left = yield from fusion.keep(state, layer, there)
        last = layer + 1 == layers
        self.expected = None if last or not left else (state, layer + 1, left)
        if last and left:
            yield from self._made(fusion, state, left)

    def _made(self, fusion: Fusion, number: int, size: int) -> Steps[None]:
        """Fuse, tell what others turn their qubits by, turn the own ones, and use what is left."""
        place, hosts = fusion.place, fusion.graph.hosts
        fused = yield from fusion.fuse(number, size)
        self.fused += size * (len(fusion.halves) > 1)
        count = (hosts - place) * size
        heard = yield from hear(Topic.CORRECTIONS, number, count, LOST, BITS_TIMEOUT_S)
        behind = combined(fused[place:], heard.astype(np.uint8).reshape(-1, size))
        before = np.zeros((place + 1, size), dtype=np.uint8)
        if self.right is not None:
            bits, shape = behind[1:].ravel(), before.shape
            before = yield from self.right.ask(Topic.CORRECTIONS, number, bits, 2, shape)
        states = yield from fusion.correct(number, combined(behind[0], before[-1]))
        passed = combined(fused[:place], before[:-1])
        yield self.side.say(Topic.OUTCOMES, number, passed.ravel(), 2)
        if states:
            yield from self.use(number, states)
            self.measured += states
