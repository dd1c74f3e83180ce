"""The protocol of a pair source: it makes Bell pairs and sends both halves into its fibres.

Or of a relay, to which both ends send light: it measures that in pairs, and announces what it
finds. No socket, no clock.
"""

from collections.abc import Callable, Coroutine
from typing import Any

import numpy as np

from hosts.hardware import pair_light
from hosts.hardware.block_name import BlockName
from hosts.hardware.qnic import Qnic
from hosts.hardware.replies import HardwareError
from hosts.hardware.steps import Pulses
from hosts.middleware.session.errors import SessionError, unexpected, unsupported
from hosts.middleware.session.options import MAX_BLOCK_PAIRS, MAX_BLOCK_PULSES
from hosts.middleware.session.protocol import (
    Collect,
    HearNext,
    Say,
    Side,
    Steps,
    begin,
    do,
    require_size,
)
from hosts.middleware.session.values import announcement
from hosts.timeouts import KEY_GRACE_S, LIGHT_TIMEOUT_S
from wire.metadata.blocks import Emission, Emit, Emitted
from wire.metadata.setup import Answer, Setup
from wire.metadata.vocabulary import MemoryState, Reason
from wire.outcomes import NO_COINCIDENCE

Emitting = Callable[[Qnic, int, int, int, tuple[str, str], Pulses], Coroutine[Any, Any, None]]
MOST_BEGUN = 16  # blocks of a session that follow each other without a look at what becomes of them
MOST_RELAYED = 1 << 31  # blocks; each has two numbers


def check_source(side: Side) -> None:
    """Raise SessionError for a set-up that this host cannot be the source of."""
    if len(side.ports) < 2:
        raise unsupported("a pair source needs two fibres")


def make_pairs(
    side: Side, made: Callable[[int], None], distinguishable_states: frozenset[int]
) -> Steps[None]:
    """Carry out Emit requests of one session until its connection ends; count the pairs made.

    A relay announces those Bell states alone that its analyser tells from all others.
    """
    setup, begun = side.setup, 0
    yield side.agree()
    while (request := (yield HearNext())) is not None:
        try:
            if isinstance(request, Emitted):
                yield from do(Qnic.finish, setup.session)
                yield side.agree()
                continue
            if not isinstance(request, Emit):
                raise unexpected(request, side.peer)
            _check(setup, request)
            if isinstance(request, Emission):
                yield from _emit(side, request, pair_light.begin_pairs)
                made(request.pairs)
                begun += 1
                if begun % MOST_BEGUN == 0:  # further orders wait
                    yield from do(Qnic.finish, setup.session)
                continue
            if setup.memory == MemoryState.RELAYED:
                yield from _announce(side, request, distinguishable_states)
                continue
            yield from _emit(side, request, pair_light.emit_pairs)
        except HardwareError as error:
            raise SessionError(Reason.HARDWARE, str(error)) from error
        made(request.pairs)
        yield side.agree()


def _check(setup: Setup, request: Emit) -> None:
    counted = setup.memory in (MemoryState.HERALDED, MemoryState.RELAYED)
    most = MAX_BLOCK_PAIRS if counted else MAX_BLOCK_PULSES
    if not 0 < request.pairs <= most:
        raise unsupported(f"a block of {request.pairs} pairs: choose 1 to {most} (block_pairs)")
    if not 0 < request.rate_hz <= setup.rate_hz:
        text = f"{request.rate_hz} pairs a second: {setup.rate_hz} at most were granted"
        raise SessionError(Reason.NOT_ALLOWED, text)


def _announce(side: Side, request: Emit, distinguishable: frozenset[int]) -> Steps[None]:
    session, number, pulses = request.session, request.block, request.pairs
    first, second = side.ports[:2]
    light = yield from begin(
        pair_light.detect_arrivals,
        relayed_blocks(session, number),
        (first, second),
        LIGHT_TIMEOUT_S,
    )
    reports = yield Collect(light, KEY_GRACE_S + pulses / side.setup.rate_hz)
    outcomes = np.full(pulses, NO_COINCIDENCE, dtype=np.uint8)
    if reports is not None:
        require_size(reports.outcomes.size, pulses)
        distinguished = np.isin(reports.outcomes, list(distinguishable))
        outcomes[distinguished] = reports.outcomes[distinguished]
    yield Say((Answer(session, Reason.OK), *announcement(session, number, outcomes)))


def relayed_blocks(session: int, number: int) -> tuple[BlockName, BlockName]:
    """Return the names of what opener and acceptor send to a relay as one block."""
    if number >= MOST_RELAYED:
        raise SessionError(Reason.PROTOCOL, f"block {number} of light that is relayed")
    return BlockName(session, 2 * number, 0), BlockName(session, 2 * number + 1, 0)


def _emit(side: Side, request: Emit, how: Emitting) -> Steps[None]:
    session, block, pairs = side.setup.session, request.block, request.pairs
    pulses = Pulses(request.rate_hz, side.setup.wavelength_pm)
    first, second = side.ports[:2]
    yield from do(how, session, block, pairs, (first, second), pulses)
