"""GHZ states of a line of hosts, measured to tell how good they are.

protocol.py and line.py decide; connections.py opens the sessions between neighbours.
"""

from hosts.middleware.services.ghz import connections
from hosts.middleware.services.ghz.options import GhzOptions
from hosts.middleware.services.ghz.protocol import Follower, Leader
from hosts.middleware.session.ends import AcceptorEnd, OpenerEnd, ServiceKind
from wire.metadata.vocabulary import Service


async def lead(end: OpenerEnd, options: GhzOptions) -> None:
    await connections.lead(end, options, Leader)


async def follow(end: AcceptorEnd) -> None:
    await connections.follow(end, Follower)


KIND = ServiceKind(Service.GHZ, GhzOptions, lead, follow)
