"""Numbers of two bits, four to a byte; numpy's packing of bits is the independent one."""

import numpy as np
import pytest

from wire import dibits

SIZES = [0, 1, 2, 3, 4, 5, 1023, 1024]


def by_bits(numbers: dibits.Numbers) -> bytes:
    return np.packbits(np.stack([numbers >> 1, numbers & 1], axis=1)).tobytes()


def test_the_first_number_is_in_the_highest_bits() -> None:
    assert dibits.pack(np.array([3, 0, 1, 2, 2], np.uint8)) == bytes([0b11000110, 0b10000000])


@pytest.mark.parametrize("size", SIZES)
def test_numbers_are_packed_as_their_bits_are(size: int) -> None:
    numbers = np.random.default_rng(size).integers(0, 4, size, np.uint8)
    assert dibits.pack(numbers) == by_bits(numbers)
    assert dibits.unpack(by_bits(numbers), size).tolist() == numbers.tolist()


@pytest.mark.parametrize("size", SIZES)
def test_the_other_order_has_the_first_number_in_the_lowest_bits(size: int) -> None:
    numbers = np.random.default_rng(size).integers(0, 4, size, np.uint8)
    low_first = np.stack([numbers & 1, numbers >> 1], axis=1)
    expected = np.packbits(low_first, bitorder="little").tobytes()
    assert dibits.pack(numbers, "little") == expected
    assert dibits.unpack(expected, size, "little").tolist() == numbers.tolist()


@pytest.mark.parametrize("order", ["big", "little"])
@pytest.mark.parametrize("size", SIZES)
def test_some_numbers_are_read_and_written_by_their_positions(
    size: int, order: dibits.Order
) -> None:
    numbers = np.random.default_rng(size).integers(0, 4, size, np.uint8)
    some = np.random.default_rng(size).permutation(size)[: size // 2]
    assert dibits.at(dibits.pack(numbers, order), some, order).tolist() == numbers[some].tolist()
    few = np.zeros(size, np.uint8)
    few[some] = numbers[some]
    assert dibits.scattered(some, numbers[some], size, order) == dibits.pack(few, order)


def test_parts_of_an_array_are_packed_as_well() -> None:
    numbers = np.random.default_rng(1).integers(0, 4, 99, np.uint8)
    assert dibits.pack(numbers[::3]) == by_bits(numbers[::3])
    assert dibits.pack(numbers[1:]) == by_bits(numbers[1:])


@pytest.mark.parametrize(("packed", "count"), [(b"", 1), (b"\0", 0), (b"\0", 5), (b"\0\0", 4)])
def test_too_few_and_too_many_bytes_are_refused(packed: bytes, count: int) -> None:
    with pytest.raises(ValueError, match=f"{len(packed)} bytes for {count} numbers"):
        dibits.unpack(packed, count)


@pytest.mark.parametrize(("last", "count"), [(1, 7), (4, 6), (0x3F, 5)])
def test_bits_behind_the_last_number_are_refused(last: int, count: int) -> None:
    with pytest.raises(ValueError, match=f"behind the last of {count}"):
        dibits.unpack(bytes([0, last]), count)


@pytest.mark.parametrize("packed", [b"", b"\x1b", bytes(range(256))])
def test_each_number_is_counted(packed: bytes) -> None:
    expected = np.bincount(dibits.unpack(packed, 4 * len(packed)), minlength=4)
    assert dibits.counts(packed).tolist() == expected.tolist()
