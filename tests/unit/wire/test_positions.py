"""Positions of photons as bytes."""

import numpy as np
import pytest

from wire.positions import pack, unpack


def test_positions_in_any_order_are_read_as_written() -> None:
    assert pack([3, 258]).hex() == "0300000002010000"
    positions = np.array([7, 0, 4_000_000])
    assert unpack(pack(positions)).tolist() == positions.tolist()
    assert not unpack(pack([])).size


def test_bytes_that_are_of_no_positions_are_refused() -> None:
    with pytest.raises(ValueError, match="5 bytes of positions, of 4 bytes each"):
        unpack(bytes(5))
