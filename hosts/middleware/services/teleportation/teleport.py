"""Teleportation: states of the opener appear at the acceptor, by pairs and two bits for each.

    alice                       charlie                    bob
      | <-- light, half 0 --------- | -- light, half 1 ----> |  into memory
      | Bell measurement of state and half 0                 |
      | Values(CORRECTIONS), a real packet ----------------> |  waits for it, then corrects
      | Values(STATES or DIRECTIONS) ----------------------> |  measures each for its own state
      | <---------------------------------- Values(COUNTS)   |

What arrives is checked: the opener tells which states it sent, and the acceptor measures whether
it holds them: the share of those that it finds is the fidelity. Random states are the six cardinal
ones, whose mean fidelity is that of all states; on the backend dense they may be any.
The acceptor cannot correct before the bits are there: they are what it corrects by.
"""

from dataclasses import dataclass

import numpy as np

from hosts.hardware.operations import BlockName
from hosts.hardware.qnic import Outcomes, Qnic, Symbols
from hosts.middleware.services.teleportation import qubit_states
from hosts.middleware.services.teleportation.protocol import (
    Correct,
    Look,
    Receiver,
    Sender,
    Teleport,
)
from hosts.middleware.services.teleportation.qubit_states import RANDOM, Cardinal, States
from hosts.middleware.session.ends import AcceptorEnd, OpenerEnd, ServiceKind
from hosts.middleware.session.service_options import ServiceOptions
from hosts.network_loop import now_s
from hosts.timeouts import ANSWER_TIMEOUT_S
from wire.metadata.values import Values
from wire.metadata.vocabulary import Service
from wire.outcomes import NO_COINCIDENCE

STATE_BLOCKS = 1 << 31  # numbers of the blocks of states, beside those of pairs


@dataclass(frozen=True)
class TeleportOptions(ServiceOptions):
    """`count` states, each the same or at random: a name or angles, as qubit_states has them."""

    state: str = RANDOM

    def check(self) -> None:
        """Raise SessionError for a value out of range."""
        super().check()
        qubit_states.check(self.state)


async def teleport(end: OpenerEnd, options: TeleportOptions) -> None:
    """Teleport all states, block after block."""
    known, started = end.resources.distinguishable_states, now_s()
    sender = Sender(end.setup, options.state, options.count, known, end.draws)
    while (order := sender.next_block()) is not None:
        for message in sender.measured(await _send(end, order)):
            end.channel.send(message)
        sender.heard(await end.channel.receive(Values, ANSWER_TIMEOUT_S))
        end.summary = sender.tally.summary(now_s() - started)
        await end.tell(**vars(end.summary))


async def _send(end: OpenerEnd, order: Teleport) -> Symbols | None:
    """Return the Bell states found of a block's states and halves 0; None if no half has come."""
    stored = await end.pairs(order.block, order.size)
    if not stored.arrived.any():
        return None
    prepared = await _prepare(end, order.states, STATE_BLOCKS + order.block)
    return await end.qnic.bell_measure(prepared, end.block(order.block))


async def _prepare(end: OpenerEnd, states: States, number: int) -> BlockName:
    session = end.setup.session
    if isinstance(states, Cardinal):
        return await end.qnic.prepare(session, number, states.symbols)
    return await end.qnic.prepare_along(session, number, states.directions)


async def receive(end: AcceptorEnd) -> None:
    """Take states in until the opener has no more."""
    receiver, started = Receiver(end.setup), now_s()
    while (coming := await end.announced(end.setup.pairs)) is not None:
        receiver.announced(*coming)
        end.channel.send(await _receive_block(end, receiver, *coming))
        end.summary = receiver.tally.summary(now_s() - started)
        await end.tell(**vars(end.summary))


async def _receive_block(end: AcceptorEnd, receiver: Receiver, number: int, size: int) -> Values:
    """Store, correct and measure a block; return what to tell of it."""
    name = end.block(number, half=1)
    light = end.expect_light(name)
    try:
        end.agree()
        correct = await _next_order(end, receiver)
        assert isinstance(correct, Correct)
        stored = await end.stored(light, size)
    finally:
        light.cancel()
    waited_us, found = 0, None
    look = await _next_order(end, receiver)
    assert isinstance(look, Look)
    if stored.arrived.any():
        # In one order: what is corrected is measured at once.
        told = await _measure(end.qnic, name, correct.operators, look.states)
        found, waited_us = told.outcomes, (told.time_ns - stored.since_ns) // 1000
    return receiver.measured(found, waited_us)


async def _next_order(end: AcceptorEnd, receiver: Receiver) -> Correct | Look:
    while True:
        message = await end.channel.receive(Values, ANSWER_TIMEOUT_S)
        if (order := receiver.hear(message)) is not None:
            return order


async def _measure(qnic: Qnic, name: BlockName, operators: Symbols, states: States) -> Outcomes:
    """Correct each qubit and measure its state: 0 as it should be, 1 orthogonal, 255 no click."""
    if isinstance(states, Cardinal):
        told = await qnic.outcomes(name, states.bases, operators)
        agrees = np.where(told.outcomes <= 1, told.outcomes ^ states.bits, NO_COINCIDENCE)
        return Outcomes(agrees.astype(np.uint8), told.time_ns)
    return await qnic.measure_along(name, states.directions, operators)


KIND = ServiceKind(Service.TELEPORT, TeleportOptions, teleport, receive)
