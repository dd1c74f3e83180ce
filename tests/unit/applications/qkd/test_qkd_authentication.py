"""Wegman-Carter tags: what passes, what does not, and what they cost."""

import numpy as np
import pytest

from applications.qkd.authentication import (
    Authenticator,
    ForgedMessage,
    KeyPool,
    KeyPoolExhausted,
    pool_bytes,
)

MATERIAL = np.random.default_rng(1).bytes(pool_bytes(4))
FIELD = (1 << 130) - 5
CLAMP = 0x0FFFFFFC0FFFFFFC0FFFFFFC0FFFFFFF


def pair() -> tuple[Authenticator, Authenticator]:
    return Authenticator(KeyPool(MATERIAL)), Authenticator(KeyPool(MATERIAL))


def test_messages_pass_in_their_order() -> None:
    signer, checker = pair()
    for message in (b"", b"one", b"two" * 1000, bytes(17)):
        checker.check(message, signer.tag(message))


def test_a_tag_is_a_polynomial_over_a_prime_field_plus_a_pad() -> None:
    """The formula of RFC 8439, section 2.5, worked out with integers."""
    message = bytes(range(40))
    point = int.from_bytes(MATERIAL[:16], "little") & CLAMP
    value = 0
    for start in range(0, 40, 16):
        value = (value + int.from_bytes(message[start : start + 16] + b"\1", "little")) * point
    signer, _checker = pair()
    signer.tag(b"first")
    pad = int.from_bytes(MATERIAL[32:48], "little")
    expected = (value % FIELD + pad) % (1 << 128)
    assert signer.tag(message) == expected.to_bytes(16, "little")


def test_every_changed_bit_is_noticed() -> None:
    for bit in range(8 * 5):
        signer, checker = pair()
        changed = (int.from_bytes(b"hello", "big") ^ 1 << bit).to_bytes(5, "big")
        with pytest.raises(ForgedMessage):
            checker.check(changed, signer.tag(b"hello"))
    for bit in range(128):
        signer, checker = pair()
        tag = (int.from_bytes(signer.tag(b"hello"), "big") ^ 1 << bit).to_bytes(16, "big")
        with pytest.raises(ForgedMessage):
            checker.check(b"hello", tag)


def test_a_replayed_message_is_refused() -> None:
    signer, checker = pair()
    tag = signer.tag(b"once")
    checker.check(b"once", tag)
    with pytest.raises(ForgedMessage):
        checker.check(b"once", tag)


def test_reordered_messages_are_refused() -> None:
    signer, checker = pair()
    signer.tag(b"first")
    with pytest.raises(ForgedMessage):
        checker.check(b"second", signer.tag(b"second"))


def test_a_message_reflected_to_its_sender_is_refused() -> None:
    there, back = MATERIAL, bytes(reversed(MATERIAL))
    alice_signs, alice_checks = Authenticator(KeyPool(there)), Authenticator(KeyPool(back))
    with pytest.raises(ForgedMessage):
        alice_checks.check(b"echo", alice_signs.tag(b"echo"))


def test_each_message_takes_128_bits_and_each_direction_128_more() -> None:
    pool = KeyPool(MATERIAL)
    signer = Authenticator(pool)
    assert pool.consumed_bits == 128
    for number in range(1, 5):
        signer.tag(b"x" * 10_000)
        assert pool.consumed_bits == 128 * (number + 1)
    assert pool.remaining_bytes == signer.messages_left == 0


def test_an_exhausted_pool_says_what_is_missing_and_takes_nothing() -> None:
    pool = KeyPool(MATERIAL[:40])
    signer = Authenticator(pool)
    signer.tag(b"one")
    with pytest.raises(KeyPoolExhausted, match=r"128 bits .* wanted, 64 left"):
        signer.tag(b"two")
    assert pool.remaining_bytes == 8


def test_key_added_to_a_pool_is_used_after_what_was_left() -> None:
    pool = KeyPool(b"ab")
    assert pool.take(1) == b"a"
    pool.add(b"cd")
    assert pool.take(3) == b"bcd"
    assert pool.consumed_bits == 32


def test_no_two_pads_are_alike() -> None:
    signer, _checker = pair()
    assert len({signer.tag(b"same") for _ in range(4)}) == 4
