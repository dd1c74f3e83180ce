"""The seal of a verdict: golden bytes, and all that it covers."""

from dataclasses import replace

import pytest

from wire.metadata.decoding import decode
from wire.metadata.setup import SEAL_BYTES, Setup
from wire.metadata.vocabulary import Service, Verdict
from wire.outcomes import Pauli
from wire.verdict import is_sealed, seal

KEY, OTHER_KEY = "00112233445566778899aabbccddeeff", "ff" * 16
CONNECTION = "10.0.0.1", 40_000, "10.0.0.2", 9010
GRANTED = Setup(
    0x0102030405060708, Service.SDC, 1, "10.0.0.3", 65_536, 256, 10_000_000, 7,
    verdict=Verdict.GRANTED, rotation=Pauli.X,
)  # fmt: skip


def test_the_seal_is_golden() -> None:
    # Computed by openssl over "verdict", the connection and the message before the seal.
    message = GRANTED.encode()
    sealed = seal(message, KEY, CONNECTION)
    assert sealed == message[:-SEAL_BYTES] + bytes.fromhex("dabc514033970dd7a1d0bd3438f6a897")
    assert decode(sealed) == replace(GRANTED, seal=sealed[-SEAL_BYTES:])
    assert is_sealed(sealed, KEY, CONNECTION)
    assert seal(sealed, KEY, CONNECTION) == sealed


def test_no_bit_of_a_sealed_message_can_be_changed() -> None:
    sealed = seal(GRANTED.encode(), KEY, CONNECTION)
    for bit in range(8 * len(sealed)):
        changed = bytearray(sealed)
        changed[bit // 8] ^= 1 << bit % 8
        assert not is_sealed(bytes(changed), KEY, CONNECTION)


@pytest.mark.parametrize(
    "connection",
    [
        ("10.0.0.4", 40_000, "10.0.0.2", 9010),
        ("10.0.0.1", 40_001, "10.0.0.2", 9010),
        ("10.0.0.1", 40_000, "10.0.0.3", 9010),
        ("10.0.0.1", 40_000, "10.0.0.2", 9011),
        ("10.0.0.2", 9010, "10.0.0.1", 40_000),
    ],
)
def test_a_seal_is_for_one_connection(connection: tuple[str, int, str, int]) -> None:
    assert not is_sealed(seal(GRANTED.encode(), KEY, CONNECTION), KEY, connection)


def test_another_host_or_none_cannot_seal() -> None:
    assert not is_sealed(seal(GRANTED.encode(), OTHER_KEY, CONNECTION), KEY, CONNECTION)
    assert not is_sealed(GRANTED.encode(), KEY, CONNECTION)
