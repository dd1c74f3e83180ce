"""Verification: both ends hash their corrected keys; different keys differ in their tags.

The hash is Poly1305 (Bernstein 2005, RFC 8439) with a key drawn at random after error
correction and sent along: keys of n bits that differ have the same tag with probability
8 ceil(n / 128) / 2**106 at most.
"""

from cryptography.hazmat.primitives.poly1305 import Poly1305

from hosts.middleware.qkd.bits import Bits, pack

HASH_KEY_BYTES = 32
TAG_BITS = 128  # disclosed, so privacy amplification takes them away


def key_tag(key: Bits, hash_key: bytes) -> bytes:
    """Return the tag of a corrected key, 16 bytes."""
    return Poly1305.generate_tag(hash_key, key.size.to_bytes(8, "big") + pack(key))


def collision_probability(key_bits: int) -> float:
    """Return the greatest chance that two different keys have the same tag."""
    blocks = -(-(64 + key_bits) // 128)
    return float(8 * blocks / 2**106)
