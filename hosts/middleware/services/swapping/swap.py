"""Entanglement swapping: pairs of both ends by way of repeaters, of the fidelity asked for.

    alice                 r1                  r2                 bob
      | -- half 1 -------> | -- half 1 -------> | -- half 1 ------> |  links, into memories
      |                    | swap               | swap              |
      |                    | two bits --------> | both swaps' ----> |  real packets; their sum
      | <----------------------------------------- Values(ARRIVED) |  corrects half 1

Further blocks are under way meanwhile, as many as the memories of all nodes take (controller).
The pairs are then used as in entanglement distribution (distribute). The controller chooses the
repeaters; waiting for their bits costs fidelity. The work of each node
is decided in protocol.py.
"""

import asyncio
from functools import partial

from hosts.hardware.replies import HardwareError
from hosts.middleware.services.distribution.distribute import make_pairs, share_pairs
from hosts.middleware.services.swapping.connections import OpenedLink
from hosts.middleware.services.swapping.link import IncomingLink, OutgoingLink
from hosts.middleware.services.swapping.protocol import Accepting, Opening
from hosts.middleware.services.switch_swap import SwapOptions
from hosts.middleware.session.ends import (
    AcceptorEnd,
    Answerer,
    ConnectionEnd,
    OpenerEnd,
    ServiceKind,
)
from hosts.middleware.session.errors import SessionError
from hosts.middleware.session.protocol import Connection
from hosts.middleware.session.swap_orders import Arrived
from hosts.timeouts import LINK_TIMEOUT_S
from wire.device import SwapOrder
from wire.metadata.vocabulary import Reason, Service


async def swap(end: OpenerEnd, options: SwapOptions) -> Answerer:
    """Make pairs with the acceptor; return what answers this end's application."""
    session = end.setup.session
    try:
        order = await end.resources.swaps.order(session)
        connection = await OpenedLink.open(end.qnic, order, end.setup, end.resources.swaps.address)
        try:
            link = OutgoingLink(connection.side, connection.port)
            opening = Opening(end.side, connection, link, order)
            end.channel.sort()
            answer = await make_pairs(end, options, opening.make, order.blocks)
            await connection.perform(link.finish())
        except (SessionError, HardwareError) as error:
            await connection.give_up(error)
            raise
        finally:
            await connection.close()
    finally:
        end.resources.swaps.forget(session)
    return answer


async def receive(end: AcceptorEnd) -> Answerer:
    """Follow the opener until it delivers; return what answers this end's application."""
    with end.resources.swaps.expecting(end.setup.session) as expected:
        end.channel.sort()
        accepting = Accepting(end.side, partial(_last_link, end, expected))
        answer = await share_pairs(end, accepting.share)
        await end.perform(accepting.finish())
        return answer


async def _last_link(
    end: AcceptorEnd, expected: asyncio.Future[Arrived]
) -> tuple[Connection, IncomingLink, SwapOrder]:
    try:
        async with asyncio.timeout(LINK_TIMEOUT_S):
            arrived = await asyncio.shield(expected)
    except TimeoutError as error:
        text = f"no link from the last repeater in {LINK_TIMEOUT_S:g} s"
        raise SessionError(Reason.PROTOCOL, text) from error
    connection = ConnectionEnd(end.qnic, arrived.setup, arrived.channel)
    return connection, IncomingLink(connection.side, arrived.order), arrived.order


KIND = ServiceKind(Service.SWAP, SwapOptions, swap, receive)
