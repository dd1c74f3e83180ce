"""Bytes to symbols and back: two alphabets, every code."""

import numpy as np
import pytest

from hosts.hardware.replies import Symbols
from hosts.middleware.services.superdense.coding import CODES, Bits, Code
from hosts.middleware.services.superdense.frame_format import ALPHABETS, Alphabet, FrameFormat
from wire.metadata.vocabulary import Fec
from wire.outcomes import NO_COINCIDENCE

DIBITS, TRITS = ALPHABETS[4], ALPHABETS[3]
PLAIN = FrameFormat()
SEED = 1


def random_bits(count: int) -> Bits:
    return np.random.default_rng(SEED).integers(0, 2, count, dtype=np.uint8)


def lose(symbols: Symbols, *places: int) -> Symbols:
    symbols = symbols.copy()
    symbols[list(places)] = NO_COINCIDENCE
    return symbols


def test_a_byte_is_four_symbols_high_bits_first() -> None:
    assert PLAIN.to_symbols(b"\x1b").tolist() == [0b00, 0b01, 0b10, 0b11]


def test_every_byte_survives() -> None:
    data = bytes(range(256))
    assert PLAIN.to_bytes(PLAIN.to_symbols(data), 256) == data


def test_eleven_bits_are_seven_symbols_of_three() -> None:
    number = 0b101_1010_0111
    bits = np.array([number >> place & 1 for place in range(10, -1, -1)], dtype=np.uint8)
    symbols = TRITS.to_symbols(bits)
    assert sum(int(s) * 3**i for i, s in enumerate(reversed(symbols))) == number
    assert symbols.size == 7
    assert symbols.max() < 3


@pytest.mark.parametrize("alphabet", ALPHABETS.values(), ids=lambda a: str(a.symbols))
@pytest.mark.parametrize("count", [1, 2, 3, 10, 11, 12, 8 * 256, 3933])
def test_bits_of_any_number_survive(alphabet: Alphabet, count: int) -> None:
    bits = random_bits(count)
    symbols = alphabet.to_symbols(bits)
    assert symbols.size == alphabet.pairs(count)
    assert symbols.max() < alphabet.symbols
    got, erased = alphabet.to_bits(symbols, count)
    assert (got == bits).all()
    assert not erased.any()


def test_all_eleven_bits_are_different_sevens_of_symbols() -> None:
    numbers = np.arange(1 << 11)[:, None] >> np.arange(10, -1, -1) & 1
    symbols = TRITS.to_symbols(numbers.astype(np.uint8).reshape(-1)).reshape(-1, 7)
    assert len({tuple(row) for row in symbols.tolist()}) == 1 << 11


@pytest.mark.parametrize(("alphabet", "lost"), [(DIBITS, [4, 5]), (TRITS, list(range(11)))])
def test_a_lost_pair_erases_its_bits_and_no_others(alphabet: Alphabet, lost: list[int]) -> None:
    bits = random_bits(33)
    got, erased = alphabet.to_bits(lose(alphabet.to_symbols(bits), 2), 33)
    assert np.flatnonzero(erased).tolist() == lost
    assert (got == bits)[~erased].all()


def test_symbols_that_stand_for_no_eleven_bits_are_erased() -> None:
    most = [2, 2, 1, 0, 2, 1, 1]  # 2047
    assert not TRITS.to_bits(np.array(most, dtype=np.uint8), 11)[1].any()
    beyond = [2, 2, 1, 0, 2, 1, 2]  # 2048
    assert TRITS.to_bits(np.array(beyond, dtype=np.uint8), 11)[1].all()


@pytest.mark.by_day(every=3)
@pytest.mark.parametrize("alphabet", ALPHABETS.values(), ids=lambda a: str(a.symbols))
@pytest.mark.parametrize("interleaved", [False, True])
@pytest.mark.parametrize("code", CODES.values(), ids=lambda code: code.name)
@pytest.mark.parametrize("size", [1, 16, 256])
def test_every_frame_survives(code: Code, interleaved: bool, alphabet: Alphabet, size: int) -> None:
    used = FrameFormat(code, interleaved, alphabet)
    data = np.random.default_rng(SEED).bytes(size)
    symbols = used.to_symbols(data)
    assert symbols.size == used.pairs(size)
    assert used.to_bytes(symbols, size) == data


@pytest.mark.parametrize("alphabet", ALPHABETS.values(), ids=lambda a: str(a.symbols))
@pytest.mark.parametrize("fec", [Fec.HAMMING, Fec.GOLAY, Fec.REED_SOLOMON])
def test_a_code_fills_lost_pairs_and_corrects_a_wrong_one(fec: Fec, alphabet: Alphabet) -> None:
    used = FrameFormat(CODES[fec], True, alphabet)
    data = np.random.default_rng(SEED).bytes(256)
    symbols = lose(used.to_symbols(data), 3)
    symbols[200] ^= 1 if symbols[200] < 2 else 2
    assert used.to_bytes(symbols, 256) == data
