"""Blocks of pairs that a station heralds, of qubits that emit in the memories of both ends.

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
from hosts.middleware.session.blocks import keep_of_all
from hosts.middleware.session.heralded import correct_heralded
from hosts.middleware.session.service import AcceptorEnd, OpenerEnd
from wire.metadata import Topic, Values


async def by_station(end: OpenerEnd, pairs: Pairs, number: int, size: int) -> None:
    """Have the station herald a block of at most so many pairs, and keep what both ends have."""
    heralds = await end.heralded(number, size)
    count = heralds.states.size
    end.say(Topic.HERALDED, number, heralds.states, 2)
    kept = (await end.hear(Topic.ARRIVED, number, count, 1)).astype(bool)
    pairs.admit(number)
    if count:
        await keep_of_all(end.qnic, end.block(number), kept)
    pairs.facts["attempts"] = pairs.facts.get("attempts", 0) + heralds.attempts
    pairs.add(number, count, int(np.count_nonzero(kept)))


async def share_heralded(end: AcceptorEnd, pairs: Pairs, message: Values) -> None:
    """Attempt, make Phi+ of what is heralded behind the paths, and keep it."""
    number, size = end.coming(message, end.setup.pairs)
    pairs.admit(number)
    name = end.block(number, half=1)
    kept, _since_ns = await correct_heralded(end, name, size, end.qnic.ports[0])
    pairs.add(number, kept.size, int(np.count_nonzero(kept)))
