"""Entanglement swapping: pairs of both ends by way of repeaters, of the fidelity asked for.

    alice                 r1                  r2                 bob
      | -- half 1 -------> | -- half 1 -------> | -- half 1 ------> |  links, into memories
      |                    | swap               | swap              |
      |                    | two bits --------> | both swaps' ----> |  real packets; their sum
      | <----------------------------------------- Values(ARRIVED) |  corrects half 1

What is done with the pairs then is as in entanglement distribution (distribute). Who the
repeaters are is told by the controller; waiting for their bits costs fidelity.
"""

import asyncio
from collections import defaultdict
from functools import partial, reduce

import numpy as np

from hosts.hardware.qnic import BlockName, HardwareError
from hosts.middleware.services.distribution.distribute import DistributeOptions, Opening, follow
from hosts.middleware.services.distribution.pairs import Mask, Pairs
from hosts.middleware.services.swapping.bits import Bits
from hosts.middleware.services.swapping.link import IncomingLink, OutgoingLink
from hosts.middleware.session.blocks import keep_of_all, store, take
from hosts.middleware.session.errors import SessionError
from hosts.middleware.session.service import (
    AcceptorEnd,
    Answerer,
    ConnectionEnd,
    OpenerEnd,
    ServiceKind,
)
from hosts.middleware.session.swap_orders import Arrived
from hosts.middleware.session.values import values
from hosts.timeouts import BITS_TIMEOUT_S, LINK_TIMEOUT_S
from wire.metadata import MemoryState, Reason, Service, Topic, Values


async def swap(end: OpenerEnd, options: DistributeOptions) -> Answerer:
    """Make pairs with the acceptor; return what answers this end's application."""
    session = end.setup.session
    try:
        order = await end.means.swaps.order(session)
        link = await OutgoingLink.open(end.qnic, order, end.setup, end.means.swaps.address)
        try:
            answer = await Opening(end, options, partial(_acquire, end, link)).run()
            await link.finish()
        except (SessionError, HardwareError) as error:
            await link.give_up(error)
            raise
        finally:
            await link.close()
    finally:
        end.means.swaps.forget(session)
    return answer


async def _acquire(
    end: OpenerEnd, link: OutgoingLink, pairs: Pairs, number: int, size: int
) -> None:
    """Have a block of pairs made of those of all links; keep half 0 of each."""
    await end.channel.request(values(end.setup.session, Topic.COMING, number, [size], 32))
    there = await link.make(number, size)
    theirs = await end.hear(Topic.ARRIVED, number, None, 1, BITS_TIMEOUT_S)
    if theirs.size > there:
        text = f"{theirs.size} pairs of block {number}, at most {there} were sent"
        raise SessionError(Reason.PROTOCOL, text)
    pairs.admit(number)
    chosen = np.flatnonzero(theirs)
    if there:
        await take(end.qnic, end.block(number), {link.block(number): chosen})
    made = there if end.setup.memory == MemoryState.HERALDED else size
    pairs.add(number, made, chosen.size)


async def receive(end: AcceptorEnd) -> Answerer:
    """Follow the opener until it delivers; return what answers this end's application."""
    with end.means.swaps.expecting(end.setup.session) as expected:
        link = _LastLink(end, expected)
        answer = await follow(end, link.share)
        await link.finish()
        return answer


class _LastLink:
    """The link that the acceptor has, to the last repeater; it comes when the chain is there."""

    def __init__(self, end: AcceptorEnd, expected: asyncio.Future[Arrived]) -> None:
        """Wait for it only when it is needed."""
        self._end, self._expected = end, expected
        # The waits of all pairs, added up: here, and in the repeaters by their places.
        self._corrected, self._waited_ms = 0, 0.0
        self._repeaters_ms: defaultdict[int, float] = defaultdict(float)

    async def share(self, pairs: Pairs, message: Values) -> None:
        """Take a block in, correct what all swaps have told of, and keep that."""
        end = self._end
        number, size = end.coming(message, end.setup.pairs)
        pairs.admit(number)
        end.agree()
        link, place = await self._link()
        if await link.announced() != (number, size):
            raise SessionError(Reason.PROTOCOL, f"the last link does not bring block {number}")
        there = await link.take(number, size)
        swaps = [swapped async for swapped in link.swapped(number, place)]
        bits = reduce(Bits.joined, (swapped.bits for swapped in swaps), Bits.none(there))
        name = end.block(number, half=1)
        if there:
            await take(end.qnic, name, {link.block(number): np.flatnonzero(bits.seen)})
        chosen = await self._correct(name, bits, link.since_ns)
        for swapped in swaps:
            waited_ms = np.count_nonzero(bits.seen) * swapped.waited_us / 1e3
            self._repeaters_ms[swapped.place] += waited_ms
        end.say(Topic.ARRIVED, number, chosen, 1)
        pairs.add(number, size, int(np.count_nonzero(chosen)))
        if self._corrected:
            pairs.facts["waited_ms"] = self._waited_ms / self._corrected  # for the bits
            pairs.facts["repeaters_waited_ms"] = [
                waited_ms / self._corrected
                for _place, waited_ms in sorted(self._repeaters_ms.items())
            ]

    async def _correct(self, name: BlockName, bits: Bits, since_ns: int) -> Mask:
        """Return which of the pairs are in memory, corrected."""
        qnic, seen = self._end.qnic, np.flatnonzero(bits.seen)
        chosen = np.zeros(bits.size, dtype=bool)
        if seen.size:
            corrected_ns = await qnic.apply(name, bits.operators[seen])
            self._waited_ms += seen.size * (corrected_ns - since_ns) / 1e6
            self._corrected += seen.size
            kept = await store(qnic, name)
            await keep_of_all(qnic, name, kept)
            chosen[seen[kept]] = True
        return chosen

    async def finish(self) -> None:
        """Agree to the end of all links; raise SessionError for anything else."""
        link, _place = await self._link()
        if await link.announced() is not None:
            raise SessionError(Reason.PROTOCOL, "another block after all were delivered")
        link.agree()

    async def _link(self) -> tuple[IncomingLink, int]:
        """Return the link, and the place of this host in the chain."""
        try:
            async with asyncio.timeout(LINK_TIMEOUT_S):
                arrived = await asyncio.shield(self._expected)
        except TimeoutError as error:
            text = f"no link from the last repeater in {LINK_TIMEOUT_S:g} s"
            raise SessionError(Reason.PROTOCOL, text) from error
        link = ConnectionEnd(self._end.qnic, arrived.setup, arrived.channel)
        return IncomingLink(link, arrived.order), arrived.order.place


KIND = ServiceKind(Service.SWAP, DistributeOptions, swap, receive)
