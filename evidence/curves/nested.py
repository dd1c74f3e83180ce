"""A chain of links joined two by two, purified before each swap by the hosts' own protocol.

Theory is of Bell-diagonal pairs: probabilities of Phi+, Psi+, Phi- and Psi-, which add up to 1.
"""

from typing import Any, cast

import numpy as np

from dispatcher.laboratory import SESSION, Laboratory, LaboratoryHost, block_id
from evidence.curves.estimates import proportion
from evidence.curves.experiment import Experiment, Measure, Outcome, number, pairs_parameter
from evidence.curves.link import configuration, fiber
from evidence.curves.parameters import Parameter, Values
from evidence.curves.teleportation import BASES, fidelity_of
from hosts.hardware.operations import BlockName
from hosts.hardware.qnic import Qnic
from hosts.hardware.replies import Stored
from hosts.middleware.services.distribution.purification import PHOTONS, Protocol, purify
from hosts.middleware.session.performing import Performer
from wire.dispatcher_pb2 import Gate, MeasureRequest
from wire.parameters.physics import Device, Gates, PairSource

FIDELITY = Parameter("fidelity", 0.9, 0.25, 1.0)
LEVELS = Parameter("levels", 2, 0, 3)
ROUNDS = Parameter("rounds", 1, 0, 3)

GATES = Gates()  # perfect
Key = tuple[int, int]  # a block by number and half, as the laboratory has it
Bell = tuple[float, float, float, float]


class Node(Performer):
    """A host of the laboratory as a QNIC, and the performer of its protocols."""

    def __init__(self, host: LaboratoryHost) -> None:
        super().__init__(cast(Qnic, self))
        self.host = host

    async def rotate(self, name: BlockName, gates: Any) -> None:
        await self.host.apply(_key(name), gates=[Gate(name=gate) for gate in gates])

    async def controlled_x(self, control: BlockName, target: BlockName) -> None:
        gates = [Gate(name=Gate.CX, target=block_id(_key(target)))]
        await self.host.apply(_key(control), gates=gates)

    async def apply(self, name: BlockName, symbols: Any) -> None:
        await self.host.apply(_key(name), symbols)

    async def gather(self, into: BlockName, picks: Any, keep_rest: bool = False) -> None:
        chosen = {_key(name): positions for name, positions in picks.items()}
        await self.host.gather(_key(into), chosen, keep_rest)

    async def measure(self, name: BlockName, bases: Any) -> Any:
        return await self.host.measure(_key(name), bases=bases)

    async def store(self, name: BlockName) -> Stored:
        return Stored(np.frombuffer((await self.host.store(_key(name))).arrived, bool), 0)


class Chain:
    """Nodes in a row, each with a source and a fibre to the next."""

    def __init__(self, links: int, fidelity: float, seed: int, gates: Gates = GATES) -> None:
        """Build it; there is a link between two neighbours."""
        names = [f"n{place}" for place in range(links + 1)]
        ways = [(f"n{place}-q1", f"n{place + 1}-q0") for place in range(links)]
        device = Device(source=PairSource(fidelity=fidelity), gates=gates)
        fibers = [fiber(*way, length_km=0.0) for way in ways]
        laboratory = Laboratory(configuration(seed, fibers, dict.fromkeys(names, device)))
        self.nodes = [Node(laboratory.host(name)) for name in names]

    async def link(self, place: int, pairs: int, block: int) -> int:
        """Make pairs of a node and the next; return their number."""
        left, right = (self.nodes[each].host for each in (place, place + 1))
        await left.create(pairs, block)
        await left.send({(block, 1): f"n{place}-q1"})
        await right.receive((block, 1), f"n{place + 1}-q0")
        return pairs

    async def purify(
        self, ends: tuple[int, int], blocks: Key, pairs: int, protocol: Protocol = Protocol.DEJMPS
    ) -> int:
        """Do a round at both ends; return how many pairs are left."""
        names = [BlockName(SESSION, block, half) for half, block in enumerate(blocks)]
        outcomes = [
            await self.nodes[end].perform(purify(name, pairs, protocol, blocks[0]))
            for end, name in zip(ends, names, strict=True)
        ]
        agreed = np.flatnonzero(outcomes[0] == outcomes[1])
        for end, name in zip(ends, names, strict=True):
            await self.nodes[end].gather(name, {name: agreed})
        return agreed.size

    async def join(self, left: "Span", right: "Span") -> "Span":
        """Swap at the node where two spans meet; keep as many as the smaller has."""
        pairs = min(left.pairs, right.pairs)
        for span in (left, right):
            for end, half in zip(span.ends, (0, 1), strict=True):
                name = BlockName(SESSION, span.blocks[half], half)
                await self.nodes[end].gather(name, {name: np.arange(pairs)})
        middle = self.nodes[left.ends[1]].host
        outcomes = await middle.bell_measure((left.blocks[1], 1), (right.blocks[0], 0))
        await self.nodes[right.ends[1]].host.apply((right.blocks[1], 1), outcomes)
        return Span((left.ends[0], right.ends[1]), (left.blocks[0], right.blocks[1]), pairs)

    async def span(self, first: int, last: int, pairs: int, rounds: int, block: int) -> "Span":
        """Return pairs of two nodes, made level by level."""
        if last - first == 1:
            return Span(
                (first, last), (block + first,) * 2, await self.link(first, pairs, block + first)
            )
        middle = (first + last) // 2
        halves = [
            await self.span(*ends, pairs, rounds, block)
            for ends in ((first, middle), (middle, last))
        ]
        for half in halves:
            for _round in range(rounds):
                half.pairs = await self.purify(half.ends, half.blocks, half.pairs)
        return await self.join(*halves)


class Span:
    """Pairs of two nodes: the blocks of halves 0 and 1."""

    def __init__(self, ends: Key, blocks: Key, pairs: int) -> None:
        self.ends, self.blocks, self.pairs = ends, blocks, pairs


async def join_all(values: Values, seed: int) -> Outcome:
    """Join links, and measure a third of the pairs in each basis at the ends."""
    links, rounds = 2 ** int(values[LEVELS.name]), int(values[ROUNDS.name])
    chain = Chain(links, number(values, FIDELITY.name), seed)
    made = int(values["pairs"]) * PHOTONS ** (rounds * int(values[LEVELS.name])) // len(BASES)
    agreeing = []
    for turn, basis in enumerate(BASES):
        span = await chain.span(0, links, made, rounds, turn * links)
        mine, yours = [
            await chain.nodes[end].host.measure((block, half), basis)
            for half, (end, block) in enumerate(zip(span.ends, span.blocks, strict=True))
        ]
        right = int(((mine ^ yours) == (basis == MeasureRequest.Y)).sum())
        agreeing.append(proportion(right, span.pairs))
    return {"fidelity": fidelity_of(agreeing)}


def theory(values: Values) -> float:
    return nested(number(values, FIDELITY.name), int(values[LEVELS.name]), int(values[ROUNDS.name]))


def werner(fidelity: float) -> Bell:
    wrong = (1 - fidelity) / 3
    return fidelity, wrong, wrong, wrong


def swapped(one: Bell, other: Bell) -> Bell:
    """Return what a perfect swap makes of two pairs: their Pauli errors, multiplied."""
    first, second, third, fourth = (
        sum(one[error] * other[error ^ state] for error in range(4)) for state in range(4)
    )
    return first, second, third, fourth


def purified(pair: Bell) -> Bell:
    """Return what a round of DEJMPS makes of two pairs alike (Phys. Rev. Lett. 77, 2818, eq. 3)."""
    phi, psi, phi_minus, psi_minus = pair
    success = (phi + psi_minus) ** 2 + (psi + phi_minus) ** 2
    return (
        (phi**2 + psi_minus**2) / success,
        (psi**2 + phi_minus**2) / success,
        2 * phi * psi_minus / success,
        2 * psi * phi_minus / success,
    )


def nested(fidelity: float, levels: int, rounds: int) -> float:
    """Return the fidelity of 2^levels Werner links joined two by two, purified before each swap.

    Briegel, Duer, Cirac and Zoller, Phys. Rev. Lett. 81, 5932.
    """
    pair = werner(fidelity)
    for _level in range(levels):
        for _round in range(rounds):
            pair = purified(pair)
        pair = swapped(pair, pair)
    return pair[0]


def _key(name: BlockName) -> Key:
    return name.number, name.half


NESTED = Experiment(
    "nested",
    "nested purification: links joined two by two, purified before each swap",
    (FIDELITY, LEVELS, ROUNDS, pairs_parameter(20_000)),
    (Measure("fidelity", "fidelity of the pairs of both ends", theory),),
    join_all,
)
