"""Coins: random bits that two hosts have in common, from pairs that both of them measure."""

import numpy as np

from coin.service import CoinFigures
from coin.tally import TOPIC, Tally
from qmn.services import (
    NO_COINCIDENCE,
    AcceptorEnd,
    BlockName,
    Envelope,
    Hear,
    HostSide,
    OpenerEnd,
    OpenerSide,
    Qnic,
    Say,
    Service,
    ServiceKind,
    ServiceOptions,
    Steps,
    Symbols,
    Tell,
    Topic,
    do,
    hear,
)


def throw(side: OpenerSide, count: int) -> Steps[None]:
    """Have pairs made, measure half of each, and compare with the other end."""
    agreed, thrown, number = 0, 0, 0
    while left := count - thrown:
        number, size = number + 1, min(left, side.setup.pairs)
        yield from side.pairs(number, size)
        yield side.say(Topic.SAMPLE, number, np.ones(size), 1)  # the light is over: measure all
        mine = yield from coins(side.block(number), size)
        theirs = yield from hear(Topic.OUTCOMES, number, size, NO_COINCIDENCE)
        agreed += int(np.count_nonzero((mine == theirs) & (mine != NO_COINCIDENCE)))
        thrown += size
        yield Say((Envelope(side.setup.session, TOPIC, Tally(thrown, agreed).encode()),))
        yield Tell(CoinFigures(coins=thrown, agreed=agreed))


def catch(side: HostSide) -> Steps[None]:
    """Measure the other half of each pair."""
    while (coming := (yield from side.announced(side.setup.pairs))) is not None:
        number, size = coming
        light = yield from side.expect_light(side.block(number, half=1))
        yield side.agree()
        yield from hear(Topic.SAMPLE, number, size, 1)
        yield from side.stored(light, size)
        mine = yield from coins(side.block(number, half=1), size)
        turned = side.setup.rotation & 1  # a known rotation of the paths that flips Z
        bits = np.where(mine == NO_COINCIDENCE, mine, mine ^ turned)
        yield side.say(Topic.OUTCOMES, number, bits, 8)
        envelope: Envelope = yield Hear(Envelope)
        tally = Tally.decode(envelope.content)
        yield Tell(CoinFigures(coins=tally.thrown, agreed=tally.agreed))


def coins(block: BlockName, size: int) -> Steps[Symbols]:
    """Measure a block in Z."""
    return do(Qnic.measure, block, np.zeros(size, dtype=np.uint8))


async def opening(end: OpenerEnd, options: ServiceOptions) -> None:
    """Do what the opener does."""
    await end.perform(throw(end.side, options.count))


async def accepting(end: AcceptorEnd) -> None:
    """Do what the acceptor does."""
    await end.perform(catch(end.side))


KIND = ServiceKind(Service["COIN"], ServiceOptions, opening, accepting)
