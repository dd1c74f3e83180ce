"""Delivery of pairs at either end, however blocks of them come to both."""

from collections.abc import Collection

from hosts.middleware.services.distribution.pairs import Pairs
from hosts.middleware.services.distribution.protocol import Make, Opening, Share, follow
from hosts.middleware.services.distribution.purification import DistributeOptions
from hosts.middleware.session.ends import AcceptorEnd, Answerer, End, OpenerEnd
from hosts.network_loop import now_s


async def make_pairs(
    end: OpenerEnd, options: DistributeOptions, made: Make, blocks: int = 1
) -> Answerer:
    """Deliver pairs whose blocks are made in this way, `blocks` at a time.

    Return what answers the application.
    """
    opening = Opening(end.side, options, made, now_s(), blocks)
    pairs = await end.perform_together(opening.run())
    return _answerer(end, pairs)


async def share_pairs(end: AcceptorEnd, shared: Share, under_way: Collection[int] = ()) -> Answerer:
    """Follow the opener; new blocks are shared in this way, which hears of those under way."""
    pairs = await end.perform_together(follow(end.side, shared, now_s(), under_way))
    end.summary = pairs.summary(now_s())
    return _answerer(end, pairs)


def _answerer(end: End, pairs: Pairs) -> Answerer:
    return lambda question: end.perform(pairs.answer(question))
