"""A link that comes to this host: to its session if the chain ends here, else to a repeater."""

from hosts.hardware.qnic import HardwareError, release
from hosts.middleware.channel import MetadataChannel, SessionError
from hosts.middleware.receiver import check_wavelength
from hosts.middleware.services.means import Means
from hosts.middleware.services.service import ConnectionEnd
from hosts.middleware.services.session import require_fibers
from hosts.middleware.swapping.link import IncomingLink, OutgoingLink
from hosts.middleware.swapping.repeater import Repeater
from wire.device import SwapOrder
from wire.metadata import Setup
from wire.services import Role


async def serve_link(means: Means, channel: MetadataChannel, setup: Setup) -> None:
    """Do what this host has been ordered to until the link is over; SessionError if it fails."""
    check_wavelength(setup)
    require_fibers(setup, Role.ACCEPTOR, means.qnic)
    order = await means.swaps.order_of_link(setup.session)
    incoming = IncomingLink(ConnectionEnd(means.qnic, setup, channel), order)
    try:
        if not order.last:
            await _repeat(means, incoming, setup, order)
        else:
            incoming.agree()
            await means.swaps.hand_over(order, channel, setup)
    finally:
        await release(means.qnic, setup.session)


async def _repeat(means: Means, incoming: IncomingLink, setup: Setup, order: SwapOrder) -> None:
    """Open the link to the right, say that the chain is there, and swap."""
    try:
        outgoing = await OutgoingLink.open(means.qnic, order, setup, means.swaps.address)
        try:
            incoming.agree()
            await Repeater(means.qnic, (incoming, outgoing), order, means.told_apart).run()
        except (SessionError, HardwareError) as error:
            await outgoing.give_up(error)
            raise
        finally:
            await outgoing.close()
    finally:
        means.swaps.forget(order.chain)
