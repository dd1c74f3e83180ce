"""The protocol of a pair source: it makes Bell pairs and sends both halves into its fibres.

Or of a station, where memories at both ends emit: it heralds pairs of their qubits. No socket, no
clock.
"""

from collections.abc import Callable

from hosts.hardware.qnic import HardwareError, Qnic
from hosts.middleware.session.errors import SessionError, unexpected
from hosts.middleware.session.options import MAX_BLOCK_PAIRS
from hosts.middleware.session.protocol import HearNext, Say, Side, Steps, do
from hosts.middleware.session.values import words_of
from hosts.timeouts import MAX_BLOCK_S
from wire.metadata import Emit, MemoryState, Reason, Setup


def check_source(side: Side) -> None:
    """Raise SessionError for a set-up that this host cannot be the source of."""
    if len(side.ports) < 2:
        raise SessionError(Reason.UNSUPPORTED, "a pair source needs two fibres")


def make_pairs(side: Side, made: Callable[[int], None]) -> Steps[None]:
    """Answer Emit requests of one session until its connection ends; count the pairs made."""
    setup = side.setup
    yield side.agree()
    while (request := (yield HearNext())) is not None:
        if not isinstance(request, Emit):
            raise unexpected(request, side.peer)
        _check(setup, request)
        try:
            if setup.memory == MemoryState.HERALDED:
                made((yield from _herald(side, request)))
                continue
            yield from _emit(side, request)
        except HardwareError as error:
            raise SessionError(Reason.HARDWARE, str(error)) from error
        made(request.pairs)
        yield side.agree()


def _check(setup: Setup, request: Emit) -> None:
    if not 0 < request.pairs <= MAX_BLOCK_PAIRS:
        text = f"a block of {request.pairs} pairs: choose 1 to {MAX_BLOCK_PAIRS} (block_pairs)"
        raise SessionError(Reason.UNSUPPORTED, text)
    if not 0 < request.rate_hz <= setup.rate_hz:
        text = f"{request.rate_hz} pairs a second: {setup.rate_hz} at most were granted"
        raise SessionError(Reason.NOT_ALLOWED, text)


def _herald(side: Side, request: Emit) -> Steps[int]:
    """Herald a block, and tell of it by a packet; return how many pairs."""
    block = request.session, request.block, request.pairs
    first, second = side.ports[:2]
    heralds = yield from do(Qnic.herald, *block, (first, second), MAX_BLOCK_S)
    yield Say(words_of(request.session, request.block, heralds))
    return heralds.states.size


def _emit(side: Side, request: Emit) -> Steps[None]:
    """Make a block, and send both its halves."""
    block = side.setup.session, request.block, request.pairs
    light = request.rate_hz, side.setup.wavelength_pm
    first, second = side.ports[:2]
    yield from do(Qnic.emit_pairs, *block, (first, second), *light)
