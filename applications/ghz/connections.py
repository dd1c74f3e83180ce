"""The sessions of a line of hosts: each has one with the next, the first asks.

line.py decides on messages and work; here connections are opened. A host that is asked opens
the next one's session before it says that it is ready, so that the line stands when the leader
hears that; what goes wrong behind a host ends the sessions before it, too.
"""

from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from dataclasses import replace
from functools import partial

from applications.ghz.line import (
    Follower,
    Leader,
    Right,
    asked_of_next,
    introduce,
    introduced,
    most_states,
)
from applications.ghz.options import GhzOptions
from hosts.hardware.qnic import release
from hosts.hardware.replies import HardwareError
from hosts.middleware.session import node_features
from hosts.middleware.session.arrangement import Arrangement, Light
from hosts.middleware.session.ends import AcceptorEnd, ConnectionEnd, OpenerEnd, ServiceKind
from hosts.middleware.session.errors import SessionError
from wire.metadata.values import Topic
from wire.metadata.vocabulary import Reason, Service


def line(
    service: Service,
    options: type[GhzOptions],
    leader: Callable[..., Leader],
    follower: Callable[..., Follower],
) -> ServiceKind:
    """Return a service of a line of hosts, by what its two kinds of ends do."""
    return ServiceKind(service, options, partial(lead, kind=leader), partial(follow, kind=follower))


async def lead(end: OpenerEnd, options: GhzOptions, kind: Callable[..., Leader]) -> None:
    most = await end.perform(introduce(end.side, options.names[2:]))
    most = min(most, end.setup.pairs, most_states(len(options.names) - 1))
    leader = kind(end.side, Right(end, end.side), options, most)
    await end.perform(leader.run())


async def follow(end: AcceptorEnd, kind: Callable[..., Follower]) -> None:
    names = await end.perform(introduced())
    if not names:
        end.say(Topic.COUNTS, 0, [end.setup.pairs], 32)
        await end.perform(kind(end.side, None, 0).run())
        return
    async with _opened(end, names[0]) as right:
        most = await right.perform(introduce(right.side, names[1:]))
        # Of each state there are two halves in this host's memory until they are fused.
        capacity = max(1, end.resources.node_features.memory_qubits // 2)
        end.say(Topic.COUNTS, 0, [min(most, right.setup.pairs, end.setup.pairs, capacity)], 32)
        follower = kind(end.side, Right(right, right.side), len(names))
        await end.perform(follower.run())


@asynccontextmanager
async def _opened(end: AcceptorEnd, name: str) -> AsyncIterator[ConnectionEnd]:
    address = end.resources.addresses().get(name)
    if address is None:
        raise SessionError(Reason.UNKNOWN_HOST, f"{end.resources.name} knows no host {name}")
    setup, qnic = asked_of_next(end.setup), end.qnic
    arrangement = Arrangement(setup, (name, address), name, Light())
    try:
        await arrangement.open()
        right = ConnectionEnd(qnic, setup, arrangement.channel, arrangement=arrangement)
        if node_features.are_told(Service(setup.service)):
            pairs, *_others = await right.perform(node_features.hear(right.side))
            right.setup = replace(setup, pairs=pairs)
        yield right
    except (SessionError, HardwareError) as error:
        await arrangement.give_up(error)
        raise
    finally:
        arrangement.close()
        await release(qnic, setup.session)
