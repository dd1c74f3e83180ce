"""How blocks of pairs come to both ends: from a source, or heralded by a station.

Both hosts have memories that emit where pairs are heralded:

    alice                       charlie                    bob
      | Values(COMING) ------------------------------------> |  its qubits attempt
      | Emit -------------------> |                          |
      | -- light of attempts ---> | <-- light of attempts -- |  as often as it takes
      | <----- Values(HERALDED)   |                          |  a real packet
      | Values(HERALDED) ----------------------------------> |  corrects its halves
      | <----------------------------------- Values(ARRIVED) |
"""

import numpy as np

from hosts.middleware.services.distribution.pairs import Pairs
from hosts.middleware.session.blocks import correct_heralded, correct_rotation, keep_of_all
from hosts.middleware.session.protocol import HostSide, OpenerSide, Steps, coming, hear
from wire.metadata.values import Topic, Values
from wire.metadata.vocabulary import MemoryState


def make(
    side: OpenerSide, pairs: Pairs, number: int, size: int, whole: bool = False
) -> Steps[None]:
    """Have a block of pairs made, and keep what both ends have; `whole`: nobody wants a part."""
    if side.setup.memory == MemoryState.HERALDED:
        yield from _by_station(side, pairs, number, size, whole)
        return
    stored = yield from side.pairs(number, size)
    yield side.say(Topic.ARRIVED, number, stored.arrived, 1)
    theirs = yield from hear(Topic.ARRIVED, number, size, 1)
    yield from pairs.share(number, stored.arrived, theirs.astype(bool))


def _by_station(side: OpenerSide, pairs: Pairs, number: int, size: int, whole: bool) -> Steps[None]:
    """Have the station herald a block of at most `size` pairs, and keep what both ends have."""
    heralds = yield from side.heralded(number, size, whole)
    count = heralds.states.size
    yield side.say(Topic.HERALDED, number, heralds.states, 2)
    kept = (yield from hear(Topic.ARRIVED, number, count, 1)).astype(bool)
    pairs.admit(number)
    if count:
        yield from keep_of_all(side.block(number), kept)
    pairs.facts.attempts += heralds.attempts
    pairs.add(number, count, int(np.count_nonzero(kept)))


def share(side: HostSide, pairs: Pairs, message: Values) -> Steps[None]:
    """Take in light that was announced, undo what the path did to it, keep what both ends have."""
    number, size = coming(message, side.setup.pairs)
    name = side.block(number, half=1)
    if side.setup.memory == MemoryState.HERALDED:
        pairs.admit(number)
        kept, _since_ns = yield from correct_heralded(side, name, size, side.ports[0], side.agree())
        pairs.add(number, kept.size, int(np.count_nonzero(kept)))
        return
    light = yield from side.expect_light(name)
    yield side.agree()
    theirs = yield from hear(Topic.ARRIVED, number, size, 1)
    stored = yield from side.stored(light, size)
    arrived = yield from correct_rotation(name, stored.arrived, side.setup.rotation)
    yield side.say(Topic.ARRIVED, number, arrived, 1)
    yield from pairs.share(number, arrived, theirs.astype(bool))
