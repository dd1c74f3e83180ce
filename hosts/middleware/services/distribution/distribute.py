"""Entanglement distribution: pairs in the memories of both ends, of the fidelity asked for.

    alice                       charlie                    bob
      | <-- light, half 0 --------- | -- light, half 1 ----> |  into memory, block by block
      | Values(ARRIVED) <----------------------------------> |  both keep what both have
      | Values(PURIFY), then OUTCOMES <--------------------> |  as often as it takes
      | Values(SAMPLE), BASES, then OUTCOMES <-------------> |  sacrificed for the estimate
      | Values(ARRIVED) <----------------------------------> |  what the cut-off has left of a block
      | Values(DELIVER) -----------------------------------> |  pairs have numbers: 0, 1, 2, …

If both hosts have memories that emit, pairs are heralded instead (sharing.py). protocol.py decides
on the steps; here they are carried out. Pairs stay in memory until the opener's
application ends the session; meanwhile the application at either end may ask to measure some
(Pairs.answer). They are called by session and number.
"""

from collections.abc import Collection
from functools import partial
from math import inf

from hosts.middleware.services.distribution.pairs import Pairs
from hosts.middleware.services.distribution.protocol import Make, Opening, Share, follow
from hosts.middleware.services.distribution.purification import DistributeOptions
from hosts.middleware.services.distribution.sharing import make, share
from hosts.middleware.session.ends import AcceptorEnd, Answerer, End, OpenerEnd, ServiceKind
from hosts.network_loop import now_s
from wire.metadata.vocabulary import Service


async def distribute(end: OpenerEnd, options: DistributeOptions) -> Answerer:
    """Do what the opener does; return what answers its application."""
    judged = options.fidelity or options.sample or options.rounds
    whole = not judged and end.side.lifetimes.cutoff_s == inf
    return await make_pairs(end, options, partial(make, end.side, whole=whole))


async def make_pairs(
    end: OpenerEnd, options: DistributeOptions, made: Make, blocks: int = 1
) -> Answerer:
    """Deliver pairs whose blocks are made in this way, `blocks` at a time.

    Return what answers the application.
    """
    opening = Opening(end.side, options, made, now_s(), blocks)
    pairs = await end.perform_together(opening.run())
    return answerer(end, pairs)


async def receive(end: AcceptorEnd) -> Answerer:
    """Follow the opener until it delivers; return what answers this end's application."""
    return await share_pairs(end, partial(share, end.side))


async def share_pairs(end: AcceptorEnd, shared: Share, under_way: Collection[int] = ()) -> Answerer:
    """Follow the opener; new blocks are shared in this way, which hears of those under way."""
    pairs = await end.perform_together(follow(end.side, shared, now_s(), under_way))
    end.summary = pairs.summary(now_s())
    return answerer(end, pairs)


def answerer(end: End, pairs: Pairs) -> Answerer:
    return lambda question: end.perform(pairs.answer(question))


KIND = ServiceKind(Service.DISTRIBUTE, DistributeOptions, distribute, receive)
