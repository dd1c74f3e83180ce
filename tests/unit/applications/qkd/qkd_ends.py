"""Two ends of a session back to back, with lists for a network and numpy for the light."""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.random import Generator

from applications.qkd.alice import Alice
from applications.qkd.authentication import KeyPool, pool_bytes
from applications.qkd.bits import Bits
from applications.qkd.bob import Bob
from applications.qkd.decoy import Decoys
from applications.qkd.end import Terms
from applications.qkd.messages import Bound
from applications.qkd.parameters import Parameters
from applications.qkd.sifting import Record
from wire.outcomes import NO_CLICK

SESSION = 0x0123456789ABCDEF
SHORT = Parameters(bound=Bound.ASYMPTOTIC)  # finite keys of so few photons hold no secret bit

Change = Callable[[bytes], bytes]


def random_bits(rng: Generator, count: int) -> Bits:
    return rng.integers(0, 2, count, dtype=np.uint8)


def measured(rng: Generator, bits: Bits, bases: Bits, own_bases: Bits) -> Bits:
    """Measure photons prepared in bases: the bit sent in the same basis, chance in the other."""
    random_ones = random_bits(rng, bits.size)
    return np.where(bases == own_bases, bits, random_ones).astype(np.uint8)


def bb84(
    rng: Generator, photons: int, noise: float, loss: float = 0.2, spied: float = 0.0
) -> tuple[Record, Record]:
    """Return what alice prepared and bob measured, eve resending a fraction of the light."""
    bits, bases, own_bases = (random_bits(rng, photons) for _ in range(3))
    eve_bases = random_bits(rng, photons)
    taken = rng.random(photons) < spied
    resent = np.where(taken, measured(rng, bits, bases, eve_bases), bits).astype(np.uint8)
    light_bases = np.where(taken, eve_bases, bases).astype(np.uint8)
    outcomes = measured(rng, resent, light_bases, own_bases)
    outcomes ^= (rng.random(photons) < noise).astype(np.uint8)
    outcomes[rng.random(photons) < loss] = NO_CLICK
    return Record(bases, bits), Record(own_bases, outcomes)


@dataclass
class Ends:
    """Alice, bob, and every message that has passed, in its order."""

    alice: Alice
    bob: Bob
    change: Callable[[int, bytes], list[bytes]] = lambda _number, data: [data]
    log: list[bytes] = field(default_factory=list)
    _waiting: deque[tuple[Alice | Bob, bytes]] = field(default_factory=deque)

    def to_bob(self, messages: list[bytes]) -> None:
        self._send(self.bob, messages)

    def to_alice(self, messages: list[bytes]) -> None:
        self._send(self.alice, messages)

    def _send(self, end: Alice | Bob, messages: list[bytes]) -> None:
        for message in messages:
            self._waiting.extend((end, each) for each in self.change(len(self.log), message))
            self.log.append(message)

    def deliver(self) -> None:
        """Carry messages until there is none left."""
        while self._waiting:
            end, message = self._waiting.popleft()
            answers = end.receive(message)
            (self.to_bob if end is self.alice else self.to_alice)(answers)

    def run(self, *blocks: tuple[Record, Record]) -> None:
        """Hold a whole session over blocks of light."""
        self.to_bob(self.alice.start())
        for alices, bobs in blocks:
            self.to_bob(self.alice.add_block(alices))
            self.to_alice(self.bob.add_block(bobs))
        self.to_bob(self.alice.distil())
        self.deliver()


def make_ends(
    rng: Generator,
    parameters: Parameters = SHORT,
    bobs: Parameters | None = None,
    messages: int = 1000,
    decoys: Decoys | None = None,
) -> Ends:
    """Return two ends that share enough key for a number of messages in either direction."""
    there, back = (rng.bytes(pool_bytes(messages)) for _ in range(2))
    alice = Terms(SESSION, parameters, KeyPool(there), KeyPool(back), rng.bytes)
    bob = Terms(SESSION, bobs or parameters, KeyPool(back), KeyPool(there), rng.bytes)
    return Ends(Alice(alice, decoys), Bob(bob))
