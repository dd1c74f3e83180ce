"""Pairs of two hosts by way of a switch that Bell-measures: each makes pairs and sends it halves.

    alice                          q1                          bob
      | Values(COMING) ---------------------------------------> |
      | <------------------------------------------ Answer(OK) |
      | -- light, half 1 ----------> | <---------- light, half 1 |
      | <- frame of outcomes ------- | ------ frame of outcomes -> |  real frames
      | Values(COMING: port, number) --------------------------> |  both mean the same block
      | Values(ARRIVED) <--------------------------------------> |  bob corrects; both keep

Flow entries of the switch lead light and frames: nobody here knows where it is. The pairs are
then used as in entanglement distribution.
"""

from functools import partial

import numpy as np

from hosts.hardware.operations import BlockName
from hosts.hardware.qnic import Qnic
from hosts.middleware.services.distribution.distribute import make_pairs, share_pairs
from hosts.middleware.services.distribution.pairs import Mask, Pairs
from hosts.middleware.services.distribution.purification import DistributeOptions
from hosts.middleware.session.analyser_socket import AnalyserSocket, analyser_socket
from hosts.middleware.session.blocks import store, take
from hosts.middleware.session.ends import AcceptorEnd, Answerer, OpenerEnd, ServiceKind
from hosts.middleware.session.errors import SessionError
from hosts.middleware.session.protocol import (
    HostSide,
    OpenerSide,
    Steps,
    Wait,
    coming,
    do,
    hear,
    own_pairs,
)
from wire.analyser_frames import AnalyserFrame
from wire.metadata.values import Topic, Values
from wire.metadata.vocabulary import Reason, Service
from wire.outcomes import NO_COINCIDENCE

LARGEST = (1 << 32) - 1


def make(
    side: OpenerSide, frames: AnalyserSocket, pairs: Pairs, number: int, size: int
) -> Steps[None]:
    """Have a block swapped, and keep what both ends have."""
    frames.forget()
    yield from side.announce(number, size)
    found, kept = yield from _emit(side, frames, 2 * number, size)
    yield side.say(Topic.COMING, number, [found.port, found.number], 32)
    yield side.say(Topic.ARRIVED, number, kept, 1)
    theirs = yield from hear(Topic.ARRIVED, number, size, 1)
    yield from take(side.block(number), {_kept(side, 2 * number): np.arange(size)})
    yield from pairs.share(number, kept, theirs.astype(bool))


def share(side: HostSide, frames: AnalyserSocket, pairs: Pairs, message: Values) -> Steps[None]:
    """Do the same at the end that corrects."""
    number, size = coming(message, side.setup.pairs)
    frames.forget()
    yield side.agree()
    found, kept = yield from _emit(side, frames, 2 * number + 1, size)
    theirs = yield from hear(Topic.COMING, number, 2, LARGEST)
    if theirs.tolist() != [found.port, found.number]:
        text = f"outcomes of block {found.number} at inner port {found.port} came here, of block "
        text += f"{theirs[1]} at {theirs[0]} to {side.peer}: let no other session use the analyser"
        raise SessionError(Reason.PROTOCOL, text)
    arrived = yield from hear(Topic.ARRIVED, number, size, 1)
    name = side.block(number, half=1)
    yield from take(name, {_kept(side, 2 * number + 1): np.arange(size)})
    states = np.frombuffer(found.outcomes, np.uint8)
    yield from do(Qnic.apply, name, np.where(kept, states, 0).astype(np.uint8))
    kept &= yield from store(name)
    yield side.say(Topic.ARRIVED, number, kept, 1)
    yield from pairs.share(number, kept, arrived.astype(bool))


def _emit(
    side: HostSide, frames: AnalyserSocket, number: int, size: int
) -> Steps[tuple[AnalyserFrame, Mask]]:
    """Send halves of pairs to the switch; return its outcomes, and which pairs have one."""
    stored = yield from own_pairs(side, number, size, side.ports[0])
    found: AnalyserFrame = yield Wait(partial(frames.next, size))
    states = np.frombuffer(found.outcomes, np.uint8)
    return found, stored.arrived & (states != NO_COINCIDENCE)


def _kept(side: HostSide, number: int) -> BlockName:
    return side.block(number, half=0)


async def swap(end: OpenerEnd, options: DistributeOptions) -> Answerer:
    """Do what the opener does; return what answers its application."""
    with analyser_socket() as frames:
        return await make_pairs(end, options, partial(make, end.side, frames))


async def receive(end: AcceptorEnd) -> Answerer:
    """Follow the opener until it delivers; return what answers this end's application."""
    with analyser_socket() as frames:
        return await share_pairs(end, partial(share, end.side, frames))


KIND = ServiceKind(Service.SWITCH_SWAP, DistributeOptions, swap, receive)
