"""A decoder that is fed, and how it is held to account.

A message that a decoder takes has a meaning: written again and read again, it is the same. Where
a format has one way to say a thing (`canonical`), the bytes written are those that were read.
It refuses all other messages with the error named, and no other.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from random import Random
from typing import Any

from spoiling import spoiled

from wire.malformed import MalformedPacket


class Fault(AssertionError):
    """A decoder has taken what does not mean what it says."""


@dataclass(frozen=True)
class Target:
    """One decoder, and how it is held to account."""

    samples: Sequence[bytes]
    decode: Callable[[bytes], Any]
    encode: Callable[[Any], bytes] | None = None  # None: nothing writes it
    canonical: bool = True
    spoil: Callable[[bytes, Random], bytes] = spoiled
    refusals: tuple[type[Exception], ...] = (MalformedPacket,)
    means: Callable[[Any], Any] = repr  # what of a value is to stay

    def try_once(self, random: Random) -> bool:
        """Feed it one spoiled sample; return whether it took it. Raise what it should not."""
        return self.take(self.spoil(random.choice(self.samples), random))

    def take(self, data: bytes) -> bool:
        """Decode, and compare what was read with what is written of it; return whether it is."""
        try:
            value = self.decode(data)
        except self.refusals:
            return False
        if self.encode is None:
            return True
        again = self.encode(value)
        if self.canonical and again != data:
            raise Fault(f"reads {value!r}, which is written {again.hex()}")
        if self.means(self.decode(again)) != self.means(value):
            raise Fault(f"reads {value!r}, but what it writes of that as another")
        return True
