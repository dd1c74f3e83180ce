"""The service of a pair source: makes Bell pairs and sends both halves into its fibres."""

from collections.abc import Callable

from hosts.hardware.qnic import HardwareError, Qnic, release
from hosts.middleware.session.channel import MetadataChannel, SessionError, unexpected
from hosts.middleware.session.offers import check_wavelength
from hosts.middleware.session.options import MAX_BLOCK_PAIRS
from wire.metadata import Answer, Emit, Reason, Setup


async def serve_pairs(
    qnic: Qnic, channel: MetadataChannel, setup: Setup, made: Callable[[int], None]
) -> None:
    """Answer Emit requests of one session until its connection ends; count the pairs made."""
    if len(qnic.ports) < 2:
        raise SessionError(Reason.UNSUPPORTED, "a pair source needs two fibres")
    check_wavelength(setup)
    channel.send(Answer(setup.session, Reason.OK))
    try:
        while (request := await channel.next()) is not None:
            if not isinstance(request, Emit):
                raise unexpected(request, channel.peer)
            await _emit(qnic, setup, request)
            made(request.pairs)
            channel.send(Answer(setup.session, Reason.OK))
    finally:
        await release(qnic, setup.session)


async def _emit(qnic: Qnic, setup: Setup, request: Emit) -> None:
    if not 0 < request.pairs <= MAX_BLOCK_PAIRS:
        text = f"a block of {request.pairs} pairs: choose 1 to {MAX_BLOCK_PAIRS} (block_pairs)"
        raise SessionError(Reason.UNSUPPORTED, text)
    if not 0 < request.rate_hz <= setup.rate_hz:
        text = f"{request.rate_hz} pairs a second: {setup.rate_hz} at most were granted"
        raise SessionError(Reason.NOT_ALLOWED, text)
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
