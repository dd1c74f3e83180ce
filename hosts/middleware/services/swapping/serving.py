"""A link that comes to this host: to its session if the chain ends here, else to a repeater."""

from hosts.hardware.qnic import HardwareError, release
from hosts.middleware.services.swapping.link import IncomingLink, OutgoingLink
from hosts.middleware.services.swapping.repeater import Repeater
from hosts.middleware.session.channel import MetadataChannel
from hosts.middleware.session.errors import SessionError
from hosts.middleware.session.host_resources import HostResources
from hosts.middleware.session.offers import check_wavelength
from hosts.middleware.session.service import ConnectionEnd
from hosts.middleware.session.session import making, require_fibers
from wire.device import SwapOrder
from wire.metadata import Setup
from wire.services import Role


async def serve_link(means: HostResources, channel: MetadataChannel, setup: Setup) -> None:
    """Do what this host has been ordered to until the link is over; SessionError if it fails."""
    check_wavelength(setup)
    means = means.at(setup.wavelength_pm)
    require_fibers(setup, Role.ACCEPTOR, means.qnic, making(setup, False))
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


async def _repeat(
    means: HostResources, incoming: IncomingLink, setup: Setup, order: SwapOrder
) -> None:
    """Open the link to the right, say that the chain is there, and swap."""
    try:
        outgoing = await OutgoingLink.open(means.qnic, order, setup, means.swaps.address)
        try:
            incoming.agree()
            await Repeater(
                means.qnic, (incoming, outgoing), order, means.distinguishable_states
            ).run()
        except (SessionError, HardwareError) as error:
            await outgoing.give_up(error)
            raise
        finally:
            await outgoing.close()
    finally:
        means.swaps.forget(order.chain)
