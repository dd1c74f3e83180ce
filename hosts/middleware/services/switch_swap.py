"""Pairs of two hosts by way of a switch that Bell-measures: each makes pairs and sends it halves.

    alice                          q1                          bob
      | Values(COMING) ---------------------------------------> |
      | <------------------------------------------ Answer(OK) |
      | -- light, half 1 ----------> | <---------- light, half 1 |
      | <- frame of outcomes ------- | ------ frame of outcomes -> |  real frames
      | Values(COMING: analysers, numbers) --------------------> |  both mean the same blocks
      | Values(ARRIVED) <--------------------------------------> |  bob corrects; both keep

Flow entries of the switch lead light and frames: nobody here knows where it is. In a chain of
switches all report, and the outcomes multiply. The pairs are then used as in entanglement
distribution.
"""

from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from hosts.hardware.operations import BlockName
from hosts.hardware.qnic import Qnic
from hosts.middleware.services.distribution.distribute import make_pairs, share_pairs
from hosts.middleware.services.distribution.pairs import Mask, Pairs
from hosts.middleware.services.distribution.purification import DistributeOptions
from hosts.middleware.session.analyser_socket import AnalyserSocket, Swapped, analyser_socket
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
from wire.analyser_frames import Receivers
from wire.metadata.values import Topic, Values
from wire.metadata.vocabulary import Reason, Service
from wire.outcomes import NO_COINCIDENCE
from wire.parameters.option import option

LARGEST = (1 << 32) - 1
MOST_SWITCHES = 64


@dataclass(frozen=True)
class SwapOptions(DistributeOptions):
    """Pairs by way of repeaters, or of switches that swap."""

    swaps: int = option(
        0,
        "quantum switches that the controller has swap (all that can); 0: hosts swap",
        metavar="N",
        range=(0, MOST_SWITCHES),
    )

    def asked(self) -> dict[str, Any]:
        return {**super().asked(), "block": self.swaps}


def make(
    side: OpenerSide, frames: AnalyserSocket, pairs: Pairs, number: int, size: int
) -> Steps[None]:
    """Have a block swapped, and keep what both ends have."""
    frames.forget()
    yield from side.announce(number, size)
    swapped, kept, since_ns = yield from _emit(side, frames, 2 * number, size)
    yield side.say(Topic.COMING, number, swapped.blocks, 32)
    yield side.say(Topic.ARRIVED, number, kept, 1)
    theirs = yield from hear(Topic.ARRIVED, number, kept.size, 1)
    yield from take(side.block(number), {_kept(side, 2 * number): swapped.positions})
    yield from pairs.share(number, kept, theirs.astype(bool), size, since_ns)


def share(side: HostSide, frames: AnalyserSocket, pairs: Pairs, message: Values) -> Steps[None]:
    """Do the same at the end that corrects."""
    number, size = coming(message, side.setup.pairs)
    frames.forget()
    yield side.agree()
    swapped, kept, since_ns = yield from _emit(side, frames, 2 * number + 1, size)
    theirs = yield from hear(Topic.COMING, number, len(swapped.blocks), LARGEST)
    if theirs.tolist() != swapped.blocks:
        text = f"{side.peer} heard of other blocks at analysers than this host: let no other "
        raise SessionError(Reason.PROTOCOL, text + "session use them")
    arrived = yield from hear(Topic.ARRIVED, number, kept.size, 1)
    name = side.block(number, half=1)
    yield from take(name, {_kept(side, 2 * number + 1): swapped.positions})
    if kept.size:
        operators = np.where(kept, swapped.outcomes, 0).astype(np.uint8)
        corrected_ns = yield from do(Qnic.apply, name, operators)
        pairs.corrected(int(np.count_nonzero(kept)), corrected_ns - since_ns)
        kept &= yield from store(name)
    yield side.say(Topic.ARRIVED, number, kept, 1)
    yield from pairs.share(number, kept, arrived.astype(bool), size, since_ns)


def _emit(
    side: HostSide, frames: AnalyserSocket, number: int, size: int
) -> Steps[tuple[Swapped, Mask, int]]:
    """Send halves of pairs to the switch; return the swaps, and which of them have made pairs.

    Also return since when (ns) the halves that stay wait, on average.
    """
    stored = yield from own_pairs(side, number, size, side.ports[0])
    swapped: Swapped = yield Wait(partial(frames.next, size, max(1, side.setup.block)))
    here = stored.arrived[swapped.positions]
    return swapped, here & (swapped.outcomes != NO_COINCIDENCE), stored.since_ns


def _kept(side: HostSide, number: int) -> BlockName:
    return side.block(number, half=0)


async def swap(end: OpenerEnd, options: SwapOptions) -> Answerer:
    """Do what the opener does; return what answers its application."""
    with analyser_socket(end.setup.session, Receivers.OPENER) as frames:
        return await make_pairs(end, options, partial(make, end.side, frames))


async def receive(end: AcceptorEnd) -> Answerer:
    """Follow the opener until it delivers; return what answers this end's application."""
    with analyser_socket(end.setup.session, Receivers.ACCEPTOR) as frames:
        return await share_pairs(end, partial(share, end.side, frames))


KIND = ServiceKind(Service.SWITCH_SWAP, SwapOptions, swap, receive)
