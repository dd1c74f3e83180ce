"""Public randomness: permutations and matrices that both ends derive from one seed.

Only choices whose secrecy does not matter come from here: the order of bits in a pass of
error correction, and the test sample, whose seed is drawn and sent when all light has been
measured. AES-256 in counter mode (FIPS 197, SP 800-38A), under a key and from a counter that
SHAKE-256 (FIPS 202) makes of seed and purpose, gives the same numbers on every machine.
"""

import hashlib

import numpy as np
from cryptography.hazmat.primitives.ciphers import Cipher, algorithms, modes

from hosts.middleware.qkd.bits import Indices, Mask

SEED_BYTES = 32
ROUNDS = 4
KEY_BYTES, COUNTER_BYTES = 32, 16  # of AES-256


def mixed(seed: bytes, purpose: str, size: int) -> Indices:
    """Return a permutation of range(size) that mixes well, at a sixth of the time of a uniform one.

    A Feistel network of random tables (Luby and Rackoff 1988), of which the numbers from size on
    are left out. Not every permutation is as likely: no sample may be drawn by it.
    """
    bits = max(2, (size - 1).bit_length())
    low = bits // 2
    rights, lefts = 1 << low, 1 << bits - low  # of what a round looks up: the other is changed
    words = np.frombuffer(_stream(seed, purpose, ROUNDS * (rights + lefts)), dtype="<u2")
    # A row for each left half and a column for each right one: of them all, the first round need
    # not look anything up.
    left = np.arange(lefts, dtype=np.uint16)[:, np.newaxis] ^ (words[:rights] & (lefts - 1))
    right = np.tile(np.arange(rights, dtype=np.uint16), (lefts, 1))
    at = rights
    for number in range(1, ROUNDS):
        if number % 2:
            right ^= (words[at : at + lefts] & (rights - 1)).take(left)
            at += lefts
        else:
            left ^= (words[at : at + rights] & (lefts - 1)).take(right)
            at += rights
    found = (left.astype(np.uint32) << low | right).ravel()
    return np.compress(found < size, found).astype(np.int64)


def subset(seed: bytes, purpose: str, size: int, count: int) -> Mask:
    """Return which of range(size) are the first `count` of its permutation: any are as likely."""
    words = np.frombuffer(_stream(seed, purpose, 8 * size), dtype="<u8")
    chosen: Mask = words <= np.partition(words, count - 1)[count - 1]
    if np.count_nonzero(chosen) > count:  # two words are alike: 1 in 10**7 times for 10**6
        chosen = np.zeros(size, dtype=np.bool_)
        chosen[permutation(seed, purpose, size)[:count]] = True
    return chosen


def _stream(seed: bytes, purpose: str, size: int) -> bytes:
    if len(seed) != SEED_BYTES:
        raise ValueError(f"a seed has {SEED_BYTES} bytes, not {len(seed)}")
    drawn = hashlib.shake_256(seed + purpose.encode()).digest(KEY_BYTES + COUNTER_BYTES)
    key, counter = drawn[:KEY_BYTES], drawn[KEY_BYTES:]
    return Cipher(algorithms.AES(key), modes.CTR(counter)).encryptor().update(bytes(size))


def permutation(seed: bytes, purpose: str, size: int) -> Indices:
    """Return a permutation of range(size), uniform for a uniform seed, one for each purpose."""
    words = _stream(seed, purpose, 8 * size)
    return np.argsort(np.frombuffer(words, dtype="<u8"), kind="stable").astype(np.int64)
