"""Links as connections: opened to the next node, and served where they come to."""

from dataclasses import dataclass

from hosts.hardware.qnic import Qnic, release
from hosts.hardware.replies import HardwareError
from hosts.middleware.services.swapping.link import (
    IncomingLink,
    OutgoingLink,
    fiber_of,
    setup_of_link,
)
from hosts.middleware.services.swapping.repeater import Repeater
from hosts.middleware.session.arrangement import Arrangement, Light
from hosts.middleware.session.channel import MetadataChannel
from hosts.middleware.session.ends import ConnectionEnd
from hosts.middleware.session.errors import SessionError
from hosts.middleware.session.host_resources import HostResources
from hosts.middleware.session.offers import check_wavelength
from hosts.middleware.session.session import making, require_fibers
from hosts.timeouts import LINK_TIMEOUT_S
from wire.device import SwapOrder
from wire.light import Role
from wire.metadata.setup import Setup
from wire.metadata.vocabulary import MemoryState


@dataclass(kw_only=True)
class OpenedLink(ConnectionEnd):
    """The connection of a link, at its left end."""

    arrangement: Arrangement
    port: str  # of its light

    @classmethod
    async def open(cls, qnic: Qnic, order: SwapOrder, asked: Setup, address: str) -> "OpenedLink":
        """Have the light to the next node arranged, as was asked; SessionError if it cannot be."""
        port = fiber_of(tuple(qnic.ports), order.right_fiber)
        setup = setup_of_link(order, asked, address)
        arrangement = Arrangement(setup, (order.right, order.right), setup.source, Light())
        try:
            await arrangement.open(LINK_TIMEOUT_S)
            arrangement.channel.sort()
            if setup.memory == MemoryState.HERALDED:
                await arrangement.engage_source()
        except BaseException:
            arrangement.close()
            raise
        return cls(qnic, setup, arrangement.channel, arrangement=arrangement, port=port)

    async def give_up(self, error: SessionError | HardwareError) -> None:
        await self.arrangement.give_up(error)

    async def close(self) -> None:
        self.arrangement.close()
        await release(self.qnic, self.setup.session)


async def serve_link(resources: HostResources, channel: MetadataChannel, setup: Setup) -> None:
    """Do what this host has been ordered to until a link that has come is over.

    It goes to the session that expects it if the chain ends here, else to a repeater. Raise
    SessionError if it fails.
    """
    check_wavelength(setup)
    resources = resources.at(setup.wavelength_pm)
    require_fibers(setup, Role.ACCEPTOR, resources.qnic, making(setup, False))
    order = await resources.swaps.order_of_link(setup.session)
    channel.sort()
    connection = ConnectionEnd(resources.qnic, setup, channel)
    incoming = IncomingLink(connection.side, order)
    try:
        if not order.last:
            await _repeat(resources, connection, incoming, order)
        else:
            connection.agree()
            await resources.swaps.hand_over(order, channel, setup)
    finally:
        await release(resources.qnic, setup.session)


async def _repeat(
    resources: HostResources, left: ConnectionEnd, incoming: IncomingLink, order: SwapOrder
) -> None:
    """Open the link to the right, report the chain complete, and swap."""
    try:
        right = await OpenedLink.open(resources.qnic, order, left.setup, resources.swaps.address)
        try:
            left.agree()
            links = incoming, OutgoingLink(right.side, right.port)
            repeater = Repeater(right, links, order, resources.distinguishable_states)
            await left.perform_together(repeater.run())
        except (SessionError, HardwareError) as error:
            await right.give_up(error)
            raise
        finally:
            await right.close()
    finally:
        resources.swaps.forget(order.chain)
