"""Distributed sensing: hosts learn the sum of phases that each of them senses.

protocol.py and ghz/line.py decide; ghz/connections.py opens the sessions between neighbours.
"""

from hosts.middleware.services.ghz import connections
from hosts.middleware.services.sensing.options import SensingOptions
from hosts.middleware.services.sensing.protocol import Follower, Leader
from hosts.middleware.session.ends import AcceptorEnd, OpenerEnd, ServiceKind
from wire.metadata.vocabulary import Service


async def lead(end: OpenerEnd, options: SensingOptions) -> None:
    await connections.lead(end, options, Leader)


async def follow(end: AcceptorEnd) -> None:
    await connections.follow(end, Follower)


KIND = ServiceKind(Service.SENSE, SensingOptions, lead, follow)
