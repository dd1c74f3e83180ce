"""Superdense coding as a service: bytes from the host that opens to the one that accepts.

    alice                        charlie                          bob
      | <------ half 0 ------------ | ------------ half 1 -------> |
      | Pauli operators, then half 0 ----------------------------> |    SDC
      | <---------------------------- Pauli operators, then half 1 |    SDC_RETURN

A return goes back on the light of a session that stands: only the last way of light is its own.
opener.py and acceptor.py decide on messages and work; here they are carried out.
"""

import asyncio
from dataclasses import replace

from hosts.middleware.services.superdense.acceptor import Acceptor, accepted
from hosts.middleware.services.superdense.opener import Opener
from hosts.middleware.services.superdense.options import SEQUENTIAL, SuperdenseOptions
from hosts.middleware.services.superdense.sender import check_frames
from hosts.middleware.session.channel import MetadataChannel
from hosts.middleware.session.encoding import DISTINGUISHABLE_STATES
from hosts.middleware.session.ends import (
    AcceptorEnd,
    Carrier,
    ConnectionEnd,
    OpenerEnd,
    ServiceKind,
)
from hosts.middleware.session.host_resources import HostResources
from hosts.network_loop import now_s
from wire.metadata.setup import Answer, Setup
from wire.metadata.vocabulary import Handshake, Service


async def open_bytes(end: OpenerEnd, options: SuperdenseOptions) -> Carrier:
    """Prepare the sending of bytes; return the way for them."""
    source, sequential = end.arrangement.source, options.handshake == SEQUENTIAL
    opener = Opener(end.side, end.answer, source, now_s(), sequential)
    end.counts, end.summary, end.sent = opener.counts, opener.summary, opener.sent

    async def send(data: bytes) -> None:
        try:
            await end.perform_together(opener.send(data))
        finally:
            end.arrangement.leave_all()
            end.summary = opener.summary
        end.sent = opener.sent

    return Carrier(send)


async def accept_bytes(end: AcceptorEnd) -> None:
    """Receive bytes until the sender has finished; raise SessionError if it does not."""
    acceptor = Acceptor(end.side, DISTINGUISHABLE_STATES[end.resources.analyser])
    singles = set[asyncio.Task[None]]()

    async def join(channel: MetadataChannel, setup: Setup) -> None:
        """Serve the handshake of a single pair."""
        steps = acceptor.join(ConnectionEnd(end.qnic, setup, channel), setup, channel.peer)
        single = asyncio.create_task(end.perform(steps))
        singles.add(single)
        single.add_done_callback(singles.discard)
        await asyncio.wait([single])
        if not single.cancelled():
            single.result()

    end.counts, end.join = acceptor.receiver.counts, join
    try:
        await end.perform(acceptor.run())
    finally:
        end.summary = acceptor.receiver.statistics
        for single in singles:
            single.cancel()


def answer_of(resources: HostResources, setup: Setup) -> Answer:
    """Return what this host says to a set-up; raise SessionError for one that it cannot serve."""
    return accepted(DISTINGUISHABLE_STATES[resources.analyser], setup)


KIND = ServiceKind(
    Service.SDC,
    SuperdenseOptions,
    open_bytes,
    accept_bytes,
    accepts=answer_of,
    check=check_frames,
    handshakes=(Handshake.FRAMED, Handshake.PER_PAIR, Handshake.ONE_PAIR),
)
RETURN_KIND = replace(KIND, service=Service.SDC_RETURN, handshakes=(Handshake.FRAMED,))
