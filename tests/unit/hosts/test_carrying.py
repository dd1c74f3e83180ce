"""How many bytes an application sends at a time: 2^20 pairs of two bits are 2^18 bytes."""

import pytest

from hosts.applications.carrying import CHUNK_BYTES, next_chunk

FIRST = CHUNK_BYTES["framed"]
GOOD = {"bell_pairs": 1_000, "received_symbols": 1_000, "rate_hz": 50_000_000, "code_rate": 1.0}


@pytest.mark.parametrize(
    ("used", "size"),
    [
        ({}, 1 << 18),
        ({"received_symbols": 500}, 1 << 17),
        ({"code_rate": 0.5}, 1 << 17),
        ({"received_symbols": 800}, 3 * FIRST),  # 0.8 * 2^18 are 3.2 times the first
        ({"received_symbols": 10}, FIRST),
        ({"received_symbols": 0}, FIRST),
        ({"bell_pairs": 0, "received_symbols": 0}, FIRST),
        ({"rate_hz": 10_000}, FIRST),  # in 5 s 12,500 bytes
        ({"rate_hz": 110_000}, 2 * FIRST),  # 137,500 bytes
    ],
)
def test_more_is_sent_at_a_time_where_more_light_arrives(used: dict[str, int], size: int) -> None:
    assert next_chunk(FIRST, {**GOOD, **used}) == size


def test_pairs_with_handshakes_of_their_own_stay_few() -> None:
    assert next_chunk(CHUNK_BYTES["per-pair"], GOOD) == CHUNK_BYTES["per-pair"]
