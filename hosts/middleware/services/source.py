"""The service of a pair source: makes Bell pairs and sends both halves into its fibres.

Or of a station, where memories at both ends emit: it heralds pairs of their qubits.
"""

from collections.abc import Callable

from hosts.hardware.qnic import HardwareError, Qnic, release
from hosts.middleware.session.channel import MetadataChannel
from hosts.middleware.session.errors import SessionError, unexpected
from hosts.middleware.session.options import MAX_BLOCK_PAIRS
from hosts.middleware.session.station_words import tell
from hosts.timeouts import MAX_BLOCK_S
from wire.metadata import Answer, Emit, MemoryState, Reason, Setup


async def serve_pairs(
    qnic: Qnic, channel: MetadataChannel, setup: Setup, made: Callable[[int], None]
) -> None:
    """Answer Emit requests of one session until its connection ends; count the pairs made."""
    if len(qnic.ports) < 2:
        raise SessionError(Reason.UNSUPPORTED, "a pair source needs two fibres")
    channel.send(Answer(setup.session, Reason.OK))
    try:
        while (request := await channel.next()) is not None:
            if not isinstance(request, Emit):
                raise unexpected(request, channel.peer)
            _check(setup, request)
            if setup.memory == MemoryState.HERALDED:
                made(await _herald(qnic, channel, request))
            else:
                await _emit(qnic, setup, request)
                made(request.pairs)
                channel.send(Answer(setup.session, Reason.OK))
    finally:
        await release(qnic, setup.session)


def _check(setup: Setup, request: Emit) -> None:
    if not 0 < request.pairs <= MAX_BLOCK_PAIRS:
        text = f"a block of {request.pairs} pairs: choose 1 to {MAX_BLOCK_PAIRS} (block_pairs)"
        raise SessionError(Reason.UNSUPPORTED, text)
    if not 0 < request.rate_hz <= setup.rate_hz:
        text = f"{request.rate_hz} pairs a second: {setup.rate_hz} at most were granted"
        raise SessionError(Reason.NOT_ALLOWED, text)


async def _herald(qnic: Qnic, channel: MetadataChannel, request: Emit) -> int:
    """Herald a block, and tell of it by a packet; return how many pairs."""
    first, second = qnic.ports[:2]
    block = request.session, request.block, request.pairs
    try:
        heralds = await qnic.herald(*block, (first, second), MAX_BLOCK_S)
    except HardwareError as error:
        raise SessionError(Reason.HARDWARE, str(error)) from error
    tell(channel, request.session, request.block, heralds)
    return heralds.states.size


async def _emit(qnic: Qnic, setup: Setup, request: Emit) -> None:
    first, second = qnic.ports[:2]
    try:
        await qnic.emit_pairs(
            setup.session,
            request.block,
            request.pairs,
            (first, second),
            request.rate_hz,
            setup.wavelength_pm,
        )
    except HardwareError as error:
        raise SessionError(Reason.HARDWARE, str(error)) from error
