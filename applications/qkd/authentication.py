"""Wegman-Carter authentication: a universal hash of each message, hidden by a one-time pad.

The hash is the polynomial of Poly1305 (Bernstein 2005, RFC 8439) over a prime field, with one
secret point for each direction; the pad, added to it modulo 2**128, is fresh from a shared
pool for every message (Wegman and Carter 1981). A message of L bytes is forged with
probability 8 ceil(L / 16) / 2**106 at most, whatever the forger can compute. The next pad of
the pool fits only the next message: a replayed or reordered one does not pass.

Each direction has a pool of its own, so that two ends that both speak never use the same pad.

Verification: both ends hash their corrected keys; different keys differ in their tags.

The hash is Poly1305 (Bernstein 2005, RFC 8439) with a key drawn at random after error
correction and sent along: keys of n bits that differ have the same tag with probability
8 ceil(n / 128) / 2**106 at most.
"""

import hmac

from cryptography.hazmat.primitives.poly1305 import Poly1305

from applications.qkd.bits import Bits, pack

POINT_BYTES = 16  # taken from the pool once
PAD_BYTES = 16  # taken from the pool for each message
TAG_BYTES = 16
HASH_KEY_BYTES = 32
TAG_BITS = 128  # disclosed, so privacy amplification takes them away


class KeyPoolExhausted(Exception):
    """There is no shared key left to authenticate with."""


class ForgedMessage(Exception):
    """A tag does not fit: the message was changed, replayed, or came out of its turn."""


def pool_bytes(messages: int) -> int:
    return POINT_BYTES + messages * PAD_BYTES


class KeyPool:
    """Shared secret bytes of one direction, each used once."""

    def __init__(self, material: bytes) -> None:
        self._material = bytearray(material)
        self._used = 0

    @property
    def consumed_bits(self) -> int:
        return 8 * self._used

    @property
    def remaining_bytes(self) -> int:
        return len(self._material) - self._used

    def take(self, count: int) -> bytes:
        """Return the next count bytes and forget them; KeyPoolExhausted if there are fewer."""
        if count > self.remaining_bytes:
            raise KeyPoolExhausted(
                f"{8 * count} bits of authentication key wanted, {8 * self.remaining_bytes} left: "
                "give the session a longer pre-shared key, or refill it from delivered keys"
            )
        start, self._used = self._used, self._used + count
        taken = bytes(self._material[start : self._used])
        self._material[start : self._used] = bytes(count)
        return taken

    def add(self, material: bytes) -> None:
        """Put more key behind what is left; both ends must do so with the same bytes."""
        self._material += material


class Authenticator:
    """Tags the messages of one direction, or checks them, in their order."""

    def __init__(self, pool: KeyPool) -> None:
        self._pool = pool
        self._point = pool.take(POINT_BYTES)

    @property
    def messages_left(self) -> int:
        return self._pool.remaining_bytes // PAD_BYTES

    def tag(self, data: bytes) -> bytes:
        """Return the tag of the next message; KeyPoolExhausted if no pad is left."""
        return Poly1305.generate_tag(self._point + self._pool.take(PAD_BYTES), data)

    def check(self, data: bytes, tag: bytes) -> None:
        """Raise ForgedMessage unless this is the next message; its pad is used up either way."""
        if not hmac.compare_digest(self.tag(data), tag):
            raise ForgedMessage("the tag does not fit the message, or it is not the next one")


def key_tag(key: Bits, hash_key: bytes) -> bytes:
    """Return the tag of a corrected key, 16 bytes."""
    return Poly1305.generate_tag(hash_key, key.size.to_bytes(8, "big") + pack(key))


def collision_probability(key_bits: int) -> float:
    blocks = -(-(64 + key_bits) // 128)
    return float(8 * blocks / 2**106)
