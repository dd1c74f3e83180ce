"""Entanglement distribution: pairs in the memories of both ends, of the fidelity asked for.

    alice                       charlie                    bob
      | <-- light, half 0 --------- | -- light, half 1 ----> |  into memory, block by block
      | Values(ARRIVED) <----------------------------------> |  both keep what both have
      | Values(PURIFY), then OUTCOMES <--------------------> |  as often as it takes
      | Values(SAMPLE), BASES, then OUTCOMES <-------------> |  sacrificed for the estimate
      | Values(ARRIVED) <----------------------------------> |  what the cut-off has left of a block
      | Values(DELIVER) -----------------------------------> |  pairs have numbers: 0, 1, 2, …

Between memories that emit, pairs are heralded instead, by a station in a switch (swapping.py).
protocol.py decides on the steps; here they are carried out. Pairs stay in memory until the opener's
application ends the session; meanwhile the application at either end may ask to measure some
(Pairs.answer). They are called by session and number.
"""

from functools import partial

from hosts.middleware.services import swapping
from hosts.middleware.services.distribution.delivery import make_pairs, share_pairs
from hosts.middleware.services.distribution.purification import DistributeOptions
from hosts.middleware.services.distribution.sharing import make, share
from hosts.middleware.session.ends import AcceptorEnd, Answerer, OpenerEnd, ServiceKind
from wire.metadata.vocabulary import MemoryState, Service


async def distribute(end: OpenerEnd, options: DistributeOptions) -> Answerer:
    if end.setup.memory == MemoryState.HERALDED:
        return await swapping.swap(end, options)
    return await make_pairs(end, options, partial(make, end.side))


async def receive(end: AcceptorEnd) -> Answerer:
    """Follow the opener until it delivers; return what answers this end's application."""
    if end.setup.memory == MemoryState.HERALDED:
        return await swapping.receive(end)
    return await share_pairs(end, partial(share, end.side))


KIND = ServiceKind(Service.DISTRIBUTE, DistributeOptions, distribute, receive)
