"""Positions by gaps: bytes by hand, every position back, and bytes that are of none."""

import tracemalloc

import numpy as np
import pytest

from wire import gaps


@pytest.mark.parametrize(
    ("positions", "encoded"),
    [
        ([], b""),
        # Without a shift: a mask.
        ([0, 1, 3], b"\x00\x00\x00\x00\x04" + bytes([0b11010000])),
        # Gaps less 1 of 9 and 5, shifted by 2: 2 and 1 zeros, then 01 and 01.
        ([9, 15], b"\x02\x00\x00\x00\x05" + bytes([0b00101000, 0b01010000])),
    ],
)
def test_positions_take_these_bytes(positions: list[int], encoded: bytes) -> None:
    assert gaps.encode(np.array(positions, np.int64)) == encoded
    assert gaps.decode(encoded, 17).tolist() == positions


@pytest.mark.parametrize("probability", [1.0, 0.5, 0.03, 1e-4])
def test_positions_come_back_in_hardly_more_bits_than_they_tell(probability: float) -> None:
    """Rice's code takes the entropy of a geometric gap and .2 bits at most, and never below 1."""
    gap = np.random.default_rng(1).geometric(probability, 20_000)
    positions = gap.cumsum() - 1
    encoded = gaps.encode(positions)
    assert np.array_equal(gaps.decode(encoded, int(positions[-1]) + 1), positions)
    misses = 1 - probability
    entropy = -np.log2(probability) - (misses * np.log2(misses) / probability if misses else 0)
    assert 8 * len(encoded) / gap.size < max(1.0, entropy) + 0.2


def test_a_mask_is_written_and_read_without_gaps() -> None:
    positions = np.arange(100_000)
    tracemalloc.start()
    encoded = gaps.encode(positions)
    written_bytes = tracemalloc.get_traced_memory()[1]
    assert np.array_equal(gaps.decode(encoded, positions.size), positions)
    read_bytes = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert written_bytes < positions.nbytes / 2  # a byte for each place, and not a gap
    assert read_bytes < 2 * positions.nbytes  # the positions alone


def test_bytes_of_no_positions_are_refused() -> None:
    encoded = gaps.encode(np.array([9, 16, 1_000_000_000]))
    gaps.decode(encoded, 1_000_000_001)
    refused = [encoded[:size] for size in range(1, len(encoded))]
    refused += [encoded + b"\0", b"\x21" + encoded[1:], encoded[:-1] + b"\xff", b"\0\0\0\0\4\xc0"]
    for data in refused:
        with pytest.raises(ValueError, match=r"gap|position"):
            gaps.decode(data, 1_000_000_001)
    for places in (1, 17, 1_000_000_000):
        with pytest.raises(ValueError, match=r"gap|position"):
            gaps.decode(encoded, places)
