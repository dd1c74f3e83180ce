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
from math import sqrt
from typing import Any

import numpy as np

from hosts.middleware.services.teleportation import qubit_states
from hosts.middleware.services.teleportation.qubit_states import RANDOM, States
from hosts.middleware.session.service import AcceptorEnd, OpenerEnd, ServiceKind
from hosts.middleware.session.service_options import ServiceOptions
from hosts.network_loop import now_s
from wire.metadata import Service, Topic
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


@dataclass
class Tally:
    """What has become of states so far."""

    states: int = 0
    arrived: int = 0
    agreed: int = 0  # of those that arrived
    waited_s: float = 0.0  # in the acceptor's memory, for the bits; summed over what arrived

    def add(self, states: int, arrived: int, agreed: int, waited_us: int) -> None:
        """Count a block, each of whose states has waited so long."""
        self.states += states
        self.arrived += arrived
        self.agreed += agreed
        self.waited_s += arrived * waited_us * 1e-6

    def summary(self, elapsed_s: float) -> dict[str, Any]:
        """Return what the application is told; None where nothing has arrived."""
        if not self.arrived:
            told = dict.fromkeys(("fidelity", "fidelity_error", "waited_ms"))
        else:
            fidelity = self.agreed / self.arrived
            told = {
                "fidelity": fidelity,
                "fidelity_error": sqrt(fidelity * (1 - fidelity) / self.arrived),  # standard error
                "waited_ms": 1000 * self.waited_s / self.arrived,
            }
        counts = {"states": self.states, "arrived": self.arrived, **told}
        return {**counts, "elapsed_s": elapsed_s, "states_per_s": self.states / elapsed_s}


async def teleport(end: OpenerEnd, options: TeleportOptions) -> None:
    """Teleport all states, block after block."""
    tally, number, started = Tally(), 0, now_s()
    while left := options.count - tally.states:
        number, size = number + 1, min(left, end.setup.pairs)
        states = qubit_states.chosen(options.state, end.draws, size)
        tally.add(size, *await _teleport_block(end, number, size, states))
        end.summary = tally.summary(now_s() - started)
        await end.tell(**end.summary)


async def _teleport_block(
    end: OpenerEnd, number: int, size: int, states: States
) -> tuple[int, ...]:
    """Return how many arrived, how many agreed, and how long they waited (us)."""
    stored = await end.pairs(number, size)
    told = np.full(size, NO_COINCIDENCE, dtype=np.uint8)
    if stored.arrived.any():
        prepared = await states.prepare(end.qnic, end.setup.session, STATE_BLOCKS + number)
        told = await end.qnic.bell_measure(prepared, end.block(number))
    seen = np.isin(told, list(end.means.distinguishable_states))
    end.say(Topic.ARRIVED, number, seen, 1)
    # The Bell state's number is the operator that undoes it.
    end.say(Topic.CORRECTIONS, number, np.where(seen, told, 0), 2)
    states.say(end, number)
    return tuple((await end.hear(Topic.COUNTS, number, 3, (1 << 32) - 1)).tolist())


async def receive(end: AcceptorEnd) -> None:
    """Take states in until the opener has no more."""
    tally, started = Tally(), now_s()
    while (coming := await end.announced(end.setup.pairs)) is not None:
        number, size = coming
        counts = await _receive_block(end, number, size)
        end.say(Topic.COUNTS, number, counts, 32)
        tally.add(size, *counts)
        end.summary = tally.summary(now_s() - started)
        await end.tell(**end.summary)


async def _receive_block(end: AcceptorEnd, number: int, size: int) -> tuple[int, int, int]:
    name = end.block(number, half=1)
    light = end.expect_light(name)
    try:
        end.agree()
        seen = await end.hear(Topic.ARRIVED, number, size, 1)
        corrections = await end.hear(Topic.CORRECTIONS, number, size, 3)
        stored = await end.stored(light, size)
    finally:
        light.cancel()
    waited_us, found = 0, np.full(size, NO_COINCIDENCE, dtype=np.uint8)
    if stored.arrived.any():
        operators = corrections.astype(np.uint8) ^ np.uint8(end.setup.rotation)
        waited_us = (await end.qnic.apply(name, operators) - stored.since_ns) // 1000
    states = await qubit_states.heard(end, number, size)
    if stored.arrived.any():
        found = await states.measure(end.qnic, name)
    arrived = seen.astype(bool) & (found != NO_COINCIDENCE)
    agreed = arrived & (found == 0)
    return int(np.count_nonzero(arrived)), int(np.count_nonzero(agreed)), waited_us


KIND = ServiceKind(Service.TELEPORT, TeleportOptions, teleport, receive)
