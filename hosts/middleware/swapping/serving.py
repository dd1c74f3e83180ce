"""A link that comes to this host: to its session if the chain ends here, else to a repeater."""

from hosts.hardware.qnic import HardwareError, Qnic, release
from hosts.middleware.channel import MetadataChannel, SessionError
from hosts.middleware.receiver import check_wavelength
from hosts.middleware.services.service import ConnectionEnd
from hosts.middleware.services.session import require_fibers
from hosts.middleware.swapping.link import IncomingLink, OutgoingLink
from hosts.middleware.swapping.orders import Swaps
from hosts.middleware.swapping.repeater import Repeater
from wire.device import SwapOrder
from wire.metadata import Setup
from wire.services import Role


async def serve_link(
    qnic: Qnic, channel: MetadataChannel, setup: Setup, swaps: Swaps, told_apart: frozenset[int]
) -> None:
    """Do what this host has been ordered to until the link is over; SessionError if it fails."""
    check_wavelength(setup)
    require_fibers(setup, Role.ACCEPTOR, qnic)
    order = await swaps.order_of_link(setup.session)
    incoming = IncomingLink(ConnectionEnd(qnic, setup, channel), order)
    try:
        if not order.last:
            await _repeat(qnic, incoming, setup, order, swaps, told_apart)
        else:
            incoming.agree()
            await swaps.hand_over(order, channel, setup)
    finally:
        await release(qnic, setup.session)


async def _repeat(
    qnic: Qnic,
    incoming: IncomingLink,
    setup: Setup,
    order: SwapOrder,
    swaps: Swaps,
    told_apart: frozenset[int],
) -> None:
    """Open the link to the right, say that the chain is there, and swap."""
    try:
        outgoing = await OutgoingLink.open(qnic, order, setup, swaps.address)
        try:
            incoming.agree()
            await Repeater(qnic, (incoming, outgoing), order, told_apart).run()
        except (SessionError, HardwareError) as error:
            await outgoing.give_up(error)
            raise
        finally:
            await outgoing.close()
    finally:
        swaps.forget(order.chain)
