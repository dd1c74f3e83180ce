"""One round of purification of a block of pairs, as one end of it does.

    pair 0, pair 2, …   --o--   kept where the outcomes at both ends agree
    pair 1, pair 3, …   --X--   measured

BBPSSW: Bennett et al., Phys. Rev. Lett. 76, 722 (1996), for Werner pairs, which a twirl makes of
any others first. DEJMPS: Deutsch et al., Phys. Rev. Lett. 77, 2818 (1996), for Bell-diagonal pairs.
Both ends do the same to member i of the block, so that it stays one pair.
"""

from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from hosts.hardware.block_name import BlockName
from hosts.hardware.qnic import Positions, Qnic
from hosts.hardware.replies import Symbols
from hosts.middleware.session.blocks import LOST, TARGETS, THIRDS, reserved, store
from hosts.middleware.session.errors import unsupported
from hosts.middleware.session.options import ServiceOptions
from hosts.middleware.session.protocol import Steps, do
from wire.analyser_frames import CYCLES, PHOTONS, QUARTER_TURNS
from wire.parameters.option import option


class Protocol(IntEnum):
    """How pairs are purified, as numbered on the wire."""

    NONE = 0
    BBPSSW = 1
    DEJMPS = 2


def purify(name: BlockName, size: int, protocol: Protocol, seed: int) -> Steps[Symbols]:
    """Compare the pairs of a block two by two; return the outcomes, 3 where a photon was lost.

    The block holds one pair of each two afterwards, in memory: those are to be kept whose
    outcomes are the same at both ends. Both ends give the same seed.
    """
    operators, thirds = np.zeros(size, dtype=np.uint8), np.zeros(size, dtype=np.uint8)
    if protocol == Protocol.BBPSSW:
        draws = np.random.default_rng(seed)
        operators = draws.integers(0, 4, size, dtype=np.uint8)
        thirds = draws.integers(0, len(THIRDS), size).astype(np.uint8)
    return (yield from compare((name, name), name.half, protocol, operators, thirds))


def compare(
    names: tuple[BlockName, BlockName],
    half: int,
    protocol: Protocol,
    operators: Symbols,
    thirds: Symbols,
) -> Steps[Symbols]:
    """Do what `purify` does at an end by operators and thirds of a turn that both ends have.

    The second name is of a block beside which others are in use meanwhile.
    """
    name, beside = names
    size = operators.size
    order: Positions = np.arange(size)
    if protocol == Protocol.BBPSSW or operators.any():
        yield from do(Qnic.apply, name, operators)
    if protocol == Protocol.BBPSSW:
        order = yield from _turn_thirds(names, half, thirds)
    else:
        yield from do(Qnic.rotate, name, QUARTER_TURNS[half])
    pairs, targets = size // PHOTONS, reserved(beside, TARGETS)
    yield from do(Qnic.gather, targets, {name: order[1 : 2 * pairs : 2]}, keep_rest=True)
    yield from do(Qnic.gather, name, {name: order[0 : 2 * pairs : 2]})
    yield from do(Qnic.controlled_x, name, targets)
    outcomes = yield from do(Qnic.measure, targets, np.zeros(pairs, dtype=np.uint8))
    arrived = yield from store(name)
    return np.where(arrived & (outcomes <= 1), outcomes, LOST).astype(np.uint8)


def _turn_thirds(
    names: tuple[BlockName, BlockName], half: int, chosen: Symbols
) -> Steps[Positions]:
    """Make Werner pairs of any; return where each is in the block now."""
    name, beside = names
    thirds: dict[BlockName, Positions] = {name: np.zeros(0, dtype=np.int64)}
    for third, number in enumerate(THIRDS):
        mine = np.flatnonzero(chosen == third)
        if mine.size:
            part = reserved(beside, number)
            yield from do(Qnic.gather, part, {name: mine}, keep_rest=True)
            if gates := CYCLES[half][third]:
                yield from do(Qnic.rotate, part, gates)
            thirds[part] = np.arange(mine.size)
    yield from do(Qnic.gather, name, thirds)
    return np.argsort(np.argsort(chosen, kind="stable"))


PROTOCOLS = tuple(protocol.name.lower() for protocol in Protocol)  # what users call them
MAX_COUNT = 1_000_000
MAX_ROUNDS = 8
MAX_SAMPLE = 0.9


@dataclass(frozen=True)
class DistributeOptions(ServiceOptions):
    """`count` pairs of this fidelity to Phi+ at least."""

    fidelity: float = option(0.0, "least fidelity to Phi+ (0: any)", metavar="F", range=(0.0, 1))
    sample: float = option(
        0.1,
        "share of the pairs that is measured for the estimate (0.1)",
        metavar="SHARE",
        range=(0.0, MAX_SAMPLE),
    )
    purification: str = option(
        "dejmps", "protocol of purification, if it is needed (dejmps)", choices=PROTOCOLS
    )
    rounds: int | None = option(
        None,
        "rounds of purification (as many as the fidelity needs)",
        metavar="N",
        range=(0, MAX_ROUNDS),
    )
    count: int = option(10_000, "pairs (10000)", metavar="N", range=(1, MAX_COUNT))

    @property
    def fidelity_ppm(self) -> int:
        return round(self.fidelity * 1_000_000)

    def check(self) -> None:
        super().check()
        if self.rounds and self.purification == "none":
            text = f"rounds is {self.rounds} and purification none: choose bbpssw or dejmps"
            raise unsupported(text)
        if self.fidelity and not self.sample:
            text = f"fidelity {self.fidelity} cannot be known with sample 0: choose 0.1, say"
            raise unsupported(text)
