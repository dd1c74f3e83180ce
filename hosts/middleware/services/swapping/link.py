"""The two ends of a link between neighbours: pairs in the memories of both, block by block.

left                                     right
  | Values(COMING) ----------------------> |  ready for the light
  | <--------------------------- Answer(OK)|
  | -- light, half 1; half 0 stays --------> |  into memory
  | Values(ARRIVED) <--------------------> |  both keep what both have, in order
  |    or both attempt, and a station heralds (hosts/middleware/session/heralded.py)
  | Values(SWAPPED, ARRIVED, CORRECTIONS) > |  the bits of each swap to the left
  | <---------------------- Values(SWAPPED) |  notice of a swap to the right, if one waits for it
"""

from collections.abc import AsyncIterator
from dataclasses import replace

import numpy as np

from hosts.hardware.qnic import BlockName, HardwareError, Qnic, release
from hosts.middleware.services.swapping.bits import MAX_OPERATOR, Bits, Swapped
from hosts.middleware.session.arrangement import Arrangement, Light
from hosts.middleware.session.blocks import keep_of_all, store
from hosts.middleware.session.errors import SessionError
from hosts.middleware.session.heralded import correct_heralded
from hosts.middleware.session.service import ConnectionEnd
from hosts.middleware.session.values import values
from hosts.timeouts import BITS_TIMEOUT_S
from wire.device import MAX_REPEATERS, NOBODY, SwapOrder
from wire.metadata import (
    SEAL_BYTES,
    Finish,
    MemoryState,
    Pauli,
    Reason,
    Service,
    Setup,
    Topic,
    Verdict,
)

NO_DIGEST = bytes(32)
MAX_WAITED_US = (1 << 32) - 1


class OutgoingLink:
    """The left end: makes the pairs."""

    def __init__(self, end: ConnectionEnd, arrangement: Arrangement, port: str) -> None:
        """Use a connection that is arranged, and this port for its light."""
        self._end, self._arrangement, self._port = end, arrangement, port
        self.since_ns = 0  # the mean time from which the last block waits

    @classmethod
    async def open(cls, qnic: Qnic, order: SwapOrder, asked: Setup, address: str) -> "OutgoingLink":
        """Have the light to the next node arranged, as was asked; SessionError if it cannot be."""
        port = fiber_of(qnic, order.right_fiber)
        setup = replace(
            asked,
            session=order.outgoing,
            service=Service.LINK,
            source=address if order.station == NOBODY else order.station,
            fidelity_ppm=0,
            verdict=Verdict.PENDING,
            rotation=Pauli.I,
            reason=Reason.OK,
            seal=bytes(SEAL_BYTES),
        )
        arrangement = Arrangement(setup, (order.right, order.right), setup.source, Light())
        try:
            await arrangement.open()
            if setup.memory == MemoryState.HERALDED:
                await arrangement.engage_source()
        except BaseException:
            arrangement.close()
            raise
        return cls(ConnectionEnd(qnic, setup, arrangement.channel), arrangement, port)

    def block(self, number: int) -> BlockName:
        """Return the name of the halves that are kept here."""
        return self._end.block(number, half=0)

    async def make(self, number: int, size: int) -> int:
        """Make a block of pairs; return how many have reached both ends, in the same order."""
        end, setup = self._end, self._end.setup
        await end.channel.request(values(setup.session, Topic.COMING, number, [size], 32))
        if setup.memory == MemoryState.HERALDED:
            return await self._herald(number, size)
        light = setup.rate_hz, setup.wavelength_pm
        stored = await end.qnic.share_pairs(setup.session, number, size, self._port, *light)
        self.since_ns = stored.since_ns
        end.say(Topic.ARRIVED, number, stored.arrived, 1)
        theirs = await end.hear(Topic.ARRIVED, number, size, 1)
        return await keep_of_all(end.qnic, self.block(number), stored.arrived & theirs.astype(bool))

    async def _herald(self, number: int, size: int) -> int:
        """Have a station herald pairs; return how many are at both ends, in the same order."""
        end, name = self._end, self.block(number)
        await end.qnic.attempt(name, self._port, end.setup.wavelength_pm)
        heralds = await self._arrangement.herald(number, size)
        end.say(Topic.HERALDED, number, heralds.states, 2)
        kept = await end.hear(Topic.ARRIVED, number, heralds.states.size, 1)
        if not kept.size:
            return 0
        self.since_ns = (await end.qnic.store(name)).since_ns
        return await keep_of_all(end.qnic, name, kept.astype(bool))

    def say(self, number: int, swapped: Swapped) -> None:
        """Tell the next node, and all behind it, of a swap here or to the left."""
        end, bits = self._end, swapped.bits
        end.channel.send(
            end.words(Topic.SWAPPED, number, [swapped.place, swapped.waited_us], 32),
            end.words(Topic.ARRIVED, number, bits.seen, 1),
            end.words(Topic.CORRECTIONS, number, bits.operators, 2),
        )

    async def notice(self, number: int) -> tuple[int, int]:
        """Return the place of a repeater to the right that has swapped, and who waits for it."""
        end = self._end
        place, waiting = await end.hear(Topic.SWAPPED, number, 2, MAX_REPEATERS, BITS_TIMEOUT_S)
        return int(place), int(waiting)

    async def finish(self) -> None:
        """End it, and all links to the right."""
        finish = Finish(self._end.setup.session, 0, NO_DIGEST)
        await self._end.channel.request(finish, BITS_TIMEOUT_S)

    async def give_up(self, error: SessionError | HardwareError) -> None:
        """Tell all nodes to the right why it ends."""
        await self._arrangement.give_up(error)

    async def close(self) -> None:
        """Let go of the connection and of what is left of the halves."""
        self._arrangement.close()
        await release(self._end.qnic, self._end.setup.session)


class IncomingLink:
    """The right end: stores what comes."""

    def __init__(self, end: ConnectionEnd, order: SwapOrder) -> None:
        """Use a connection that has been accepted, as was ordered."""
        self._end, self._port = end, fiber_of(end.qnic, order.left_fiber)
        self.since_ns = 0  # the mean time from which the last block waits

    def block(self, number: int) -> BlockName:
        """Return the name of the halves that are kept here."""
        return self._end.block(number, half=1)

    async def announced(self) -> tuple[int, int] | None:
        """Return number and size of the block that comes next; None at the end of the link."""
        message = await self._end.next_values()
        return None if message is None else self._end.coming(message, self._end.setup.pairs)

    async def take(self, number: int, size: int) -> int:
        """Store a block that was announced; return how many pairs have reached both ends."""
        end, name = self._end, self.block(number)
        if end.setup.memory == MemoryState.HERALDED:
            kept, self.since_ns = await correct_heralded(end, name, size, self._port)
            return int(np.count_nonzero(kept))
        light = end.expect_light(name, self._port)
        try:
            end.agree()
            theirs = await end.hear(Topic.ARRIVED, number, size, 1)
            stored = await end.stored(light, size)
        finally:
            light.cancel()
        self.since_ns, arrived = stored.since_ns, stored.arrived
        if arrived.any() and end.setup.rotation:
            await end.qnic.apply(name, np.full(size, end.setup.rotation, dtype=np.uint8))
            arrived = await store(end.qnic, name)
        end.say(Topic.ARRIVED, number, arrived, 1)
        return await keep_of_all(end.qnic, name, arrived & theirs.astype(bool))

    async def swapped(self, number: int, place: int) -> AsyncIterator[Swapped]:
        """Yield what every repeater left of this place tells of a block, each once."""
        missing = set(range(1, place))
        while missing:
            swapped = await self._swapped(number)
            if swapped.place not in missing:
                text = f"bits of a swap at place {swapped.place}, not of {sorted(missing)}"
                raise SessionError(Reason.PROTOCOL, text)
            missing.remove(swapped.place)
            yield swapped

    async def _swapped(self, number: int) -> Swapped:
        end = self._end
        place, waited_us = await end.hear(Topic.SWAPPED, number, 2, MAX_WAITED_US, BITS_TIMEOUT_S)
        seen = await end.hear(Topic.ARRIVED, number, None, 1)
        operators = await end.hear(Topic.CORRECTIONS, number, seen.size, MAX_OPERATOR)
        bits = Bits(seen.astype(bool), operators.astype(np.uint8))
        return Swapped(int(place), int(waited_us), bits)

    def notify(self, number: int, place: int, waiting: int) -> None:
        """Tell the place that waits for it, to the left, of a swap here or to the right."""
        self._end.say(Topic.SWAPPED, number, [place, waiting], 8)

    def agree(self) -> None:
        """Agree to what was asked last."""
        self._end.agree()


def fiber_of(qnic: Qnic, number: int) -> str:
    """Return the port of the fibre that an order names; raise SessionError if there is none."""
    if number < len(qnic.ports):
        return qnic.ports[number]
    text = f"ordered to use fibre {number} (counted from 0), this host has {len(qnic.ports)}"
    raise SessionError(Reason.UNSUPPORTED, text)
