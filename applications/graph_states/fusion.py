"""A host's part in a graph state: it swaps pairs, and fuses halves to its one qubit. No socket.

A pair of which one half has gone through H is the graph state of two. CX from one half of a host to
another, which is then measured in Z, makes one qubit of both with the neighbours of either; of
outcome 1 it is that but for Z at the neighbour of the one that was measured (Browne and Rudolph,
Phys. Rev. Lett. 95, 010501, 2005, fusion of type I). A swap that found X^a Z^b turns the qubit at
the right end of its edge by Z^a and the one at the left by Z^b. So all that a host finds are bits
by which others turn theirs by Z. A hub measures its own qubit in Y: outcome 1, like Z before it, is
Z at all its neighbours, which go through S^-1.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from applications.ghz.line import Right, Table, seen
from applications.ghz.witness import X, Y, Z
from applications.graph_states.graph import Graph, Half
from hosts.hardware.block_name import BlockName
from hosts.hardware.qnic import Qnic
from hosts.hardware.replies import Symbols
from hosts.middleware.session.blocks import LOST, Mask, keep_of_all, store
from hosts.middleware.session.protocol import Side, Steps, do

TURN = 2  # Z, as a Pauli operator


def combined(some: Table, others: Table) -> Table:
    """Return the sum of bits by which qubits are turned, LOST where one of them is."""
    lost = (some == LOST) | (others == LOST)
    return np.where(lost, LOST, some ^ others).astype(np.uint8)


def lit(graph: Graph, layer: int, place: int) -> tuple[bool, bool]:
    """Return whether a layer has pairs of a host with those before and behind it."""
    return place > 0 and graph.lit(layer, place - 1), graph.lit(layer, place)


@dataclass
class Fusion:
    graph: Graph
    place: int
    side: Side
    right: Right | None  # of the last host there is none
    halves: list[Half] = field(init=False)

    def __post_init__(self) -> None:
        self.halves = self.graph.halves(self.place)

    def number(self, state: int, layer: int) -> int:
        return state * len(self.graph.layers) + layer

    def block(self, state: int, layer: int, came: bool) -> BlockName:
        """Return the block of halves of a layer that came from the left, or were made here."""
        number = self.number(state, layer)
        if came:
            return self.side.block(number, half=1)
        assert self.right is not None  # the last host makes no pairs
        return self.right.block(number)

    def qubits(self, state: int) -> BlockName:
        """Return the block of what is this host's qubit in the end."""
        return self.block(state, *self.halves[0][:2])

    def blocks(self, state: int, layer: int) -> Iterator[BlockName]:
        """Yield all blocks of halves here, of the layers up to this one."""
        for each in range(layer + 1):
            for came, there in zip((True, False), lit(self.graph, each, self.place), strict=True):
                if there:
                    yield self.block(state, each, came)

    def keep(self, state: int, layer: int, there: Mask) -> Steps[int]:
        """Keep halves of states of which all pairs up to this layer are there; return how many."""
        for name in self.blocks(state, layer):
            yield from keep_of_all(name, there)
        return int(np.count_nonzero(there))

    def fuse(self, state: int, size: int) -> Steps[Table]:
        """Make one qubit of all halves; return by what each host turns its; shape (hosts, size)."""
        turned = np.zeros((self.graph.hosts, size), dtype=np.uint8)
        for layer, (left, right) in self.graph.swaps(self.place):
            came, own = self.block(state, layer, True), self.block(state, layer, False)
            yield from do(Qnic.controlled_x, came, own)
            self._turn(turned, right, (yield from _measured(own, size, Z)))
            self._turn(turned, left, (yield from _measured(came, size, X)))
        for half in self.halves:
            if half.came:
                yield from do(Qnic.rotate, self.block(state, half.layer, True), ["H"])
        halves = self.qubits(state)
        for half in self.halves[1:]:
            name = self.block(state, half.layer, half.came)
            yield from do(Qnic.controlled_x, halves, name)
            self._turn(turned, half.far, (yield from _measured(name, size, Z)))
        if self.is_hub:
            self._turn(turned, self.place, (yield from _measured(halves, size, Y)))
            return turned
        if self.graph.hub and self.graph.hub in self.graph.neighbours(self.place):
            yield from do(Qnic.rotate, halves, ["S_DAG"])
        turned[:, ~(yield from store(halves))] = LOST
        return turned

    @property
    def is_hub(self) -> bool:
        return self.place not in self.graph.members

    def _turn(self, turned: Table, place: int, outcomes: Symbols) -> None:
        """Have Z at a host by outcomes; what is lost here is lost for all."""
        for each in self.graph.due(place):
            turned[each] = combined(turned[each], outcomes)
        turned[:, outcomes == LOST] = LOST

    def correct(self, state: int, bits: Symbols) -> Steps[int]:
        """Turn this host's qubits, and keep those that are not lost; return how many these are."""
        if self.is_hub:
            return int(np.count_nonzero(bits != LOST))
        qubits = self.qubits(state)
        yield from do(Qnic.apply, qubits, np.where(bits == 1, TURN, 0).astype(np.uint8))
        yield from store(qubits)  # to wait until they are used
        return (yield from keep_of_all(qubits, bits != LOST))


def _measured(name: BlockName, size: int, basis: int) -> Steps[Symbols]:
    return seen((yield from do(Qnic.measure, name, np.full(size, basis, dtype=np.uint8))))
