"""Codes: what each promises to correct, in every pattern; and the residual bit errors."""

from itertools import combinations

import numpy as np
import pytest

from hosts.middleware.services.superdense.coding import (
    CODES,
    NAMES,
    Bits,
    Code,
    Mask,
    deinterleave,
    interleave,
)
from hosts.middleware.services.superdense.coding.perfect import (
    GOLAY,
    HAMMING,
    REPETITION,
    PerfectCode,
)
from wire.metadata.vocabulary import Fec

PERFECT = [REPETITION, HAMMING, GOLAY]
REED_SOLOMON = CODES[Fec.REED_SOLOMON]
SEED = 20_161_276
STANDARD_ERRORS = 5


def random_bits(count: int, seed: int = SEED) -> Bits:
    return np.random.default_rng(seed).integers(0, 2, count, dtype=np.uint8)


def none_of(count: int) -> Mask:
    return np.zeros(count, dtype=np.bool_)


def places(length: int, weight: int) -> Mask:
    """Return every choice of places, one a row."""
    chosen = np.array(list(combinations(range(length), weight)), dtype=np.int64)
    mask = np.zeros((len(chosen), length), dtype=np.bool_)
    np.put_along_axis(mask, chosen.reshape(len(chosen), weight), True, axis=1)
    return mask


@pytest.mark.parametrize("code", PERFECT, ids=lambda code: code.name)
def test_two_codewords_differ_in_as_many_places_as_the_distance_says(code: PerfectCode) -> None:
    numbers = np.arange(1, 1 << code.k)[:, None]
    data = (numbers >> np.arange(code.k) & 1).astype(np.uint8)
    weights = code.encode(data.reshape(-1)).reshape(-1, code.n).sum(axis=1)
    assert weights.min() == code.distance  # linear: distance is the least weight


@pytest.mark.parametrize(
    ("code", "errors", "erasures"),
    [
        (code, errors, erasures)
        for code in PERFECT
        for errors in range(4)
        for erasures in range(7)
        if 2 * errors + erasures < code.distance
    ],
    ids=lambda value: getattr(value, "name", str(value)),
)
def test_every_pattern_within_the_distance_is_put_right(
    code: PerfectCode, errors: int, erasures: int
) -> None:
    holes = places(code.n, erasures)
    for wrong in places(code.n, errors) if erasures else [places(code.n, errors)]:
        wrong = np.atleast_2d(wrong)
        rows = holes[~(holes & wrong).any(axis=1)] if erasures else np.zeros_like(wrong)
        data = random_bits(code.k * len(rows))
        sent = code.encode(data).reshape(-1, code.n)
        noise = random_bits(rows.size, 2).reshape(rows.shape)  # what stands in a hole is no use
        received = np.where(rows, noise, sent ^ wrong)
        got = code.decode(received.reshape(-1), rows.reshape(-1), data.size)
        assert (got == data).all()


@pytest.mark.parametrize("code", PERFECT, ids=lambda code: code.name)
def test_beyond_the_distance_the_nearest_codeword_is_found(code: PerfectCode) -> None:
    rng = np.random.default_rng(SEED)
    words = rng.integers(0, 2, (200, code.n), dtype=np.uint8)
    holes = rng.random(words.shape) < 0.45
    data = code.decode(words.reshape(-1), holes.reshape(-1), 200 * code.k)
    everything = (np.arange(1 << code.k)[:, None] >> np.arange(code.k) & 1).astype(np.uint8)
    codebook = code.encode(everything.reshape(-1)).reshape(-1, code.n)
    for word, hole, codeword in zip(
        words, holes, code.encode(data).reshape(-1, code.n), strict=True
    ):
        distances = ((codebook != word) & ~hole).sum(axis=1)
        assert ((codeword != word) & ~hole).sum() == distances.min()


@pytest.mark.parametrize(("errors", "erasures"), [(16, 0), (0, 32), (10, 12), (1, 30)])
def test_reed_solomon_puts_right_what_it_promises(errors: int, erasures: int) -> None:
    rng = np.random.default_rng(SEED)
    for size in (1, 100, 223):
        data = random_bits(8 * size)
        sent = np.packbits(REED_SOLOMON.encode(data))
        assert sent.size == size + 32
        spoiled = rng.permutation(sent.size)[: errors + erasures]
        received, holes = sent.copy(), np.zeros(sent.size, dtype=np.bool_)
        received[spoiled] ^= rng.integers(1, 256, spoiled.size, dtype=np.uint8)
        holes[spoiled[errors:]] = True
        got = REED_SOLOMON.decode(np.unpackbits(received), np.repeat(holes, 8), data.size)
        assert (got == data).all()


def test_a_reed_solomon_word_with_too_many_errors_is_given_back_as_it_came() -> None:
    data = random_bits(8 * 223)
    received = REED_SOLOMON.encode(data)
    received[: 8 * 60] ^= random_bits(8 * 60, 3)
    got = REED_SOLOMON.decode(received, none_of(received.size), data.size)
    assert (got == received[: data.size]).all()


def test_reed_solomon_cuts_data_into_equal_codewords() -> None:
    assert REED_SOLOMON.encoded_bits(8 * 256) == 8 * (256 + 2 * 32)
    assert REED_SOLOMON.word_bits(8 * 256) == 8 * (128 + 32)
    assert REED_SOLOMON.word_bits(8 * 223) == 8 * 255


@pytest.mark.by_day(every=3)
@pytest.mark.parametrize("code", CODES.values(), ids=lambda code: code.name)
@pytest.mark.parametrize("size", [1, 2, 3, 11, 12, 13, 64, 223, 224, 447, 2048])
def test_data_of_any_size_comes_back(code: Code, size: int) -> None:
    data = random_bits(8 * size)
    encoded = code.encode(data)
    assert encoded.size == code.encoded_bits(data.size)
    assert (code.decode(encoded, none_of(encoded.size), data.size) == data).all()
    travels = interleave(code, encoded, data.size)
    assert (deinterleave(code, travels, data.size) == encoded).all()


@pytest.mark.parametrize("code", CODES.values(), ids=lambda code: code.name)
def test_systematic_codes_begin_with_their_data(code: Code) -> None:
    data = random_bits(8) if code.fec == Fec.REED_SOLOMON else random_bits(getattr(code, "k", 8))
    assert (code.encode(data)[: data.size] == data).all()


@pytest.mark.parametrize("code", [HAMMING, GOLAY], ids=lambda code: code.name)
@pytest.mark.parametrize(("group", "words"), [(2, 2), (2, 7), (11, 11), (11, 170)])
def test_interleaving_parts_the_bits_of_a_codeword(
    code: PerfectCode, group: int, words: int
) -> None:
    word = np.repeat(np.arange(words), code.n)
    travels = np.pad(interleave(code, word.astype(np.uint8), words * code.k), (0, group))
    for start in range(0, word.size - group + 1, group):
        together = travels[start : start + group]
        assert len(set(together.tolist())) == group


def test_interleaving_keeps_the_bits_of_a_byte_together_for_reed_solomon() -> None:
    data = 8 * 446
    octets = np.arange(2 * 255) % 256
    encoded = np.unpackbits(octets.astype(np.uint8))
    travels = np.packbits(interleave(REED_SOLOMON, encoded, data))
    assert travels[:4].tolist() == [0, 255, 1, 0]  # byte 0 of both words, then byte 1


def test_codes_have_names_and_numbers() -> None:
    assert NAMES == {
        "none": 0,
        "repetition": 1,
        "hamming": 2,
        "golay": 3,
        "reed-solomon": 4,
    }


def dibit_channel(bits: Bits, p: float, seed: int) -> Bits:
    """Send bits two by two: each dibit suffers one of three errors, with probability p/4 each."""
    dibits = -(-bits.size // 2)
    draws = np.random.default_rng(seed).random(dibits)
    error = np.zeros(dibits, dtype=np.uint8)
    for which in (1, 2, 3):
        error[(draws >= (which - 1) * p / 4) & (draws < which * p / 4)] = which
    return bits ^ np.stack([error >> 1, error & 1], axis=1).reshape(-1)[: bits.size]


@pytest.mark.by_day(every=3)
@pytest.mark.parametrize(
    ("code", "p", "interleaved", "theory"),
    [
        (REPETITION, 0.05, False, 1.313e-2),
        (HAMMING, 0.05, False, 2.008e-2),
        (GOLAY, 0.05, False, 3.665e-3),
        (REPETITION, 0.05, True, 1.844e-3),
        (HAMMING, 0.05, True, 5.230e-3),
        (GOLAY, 0.05, True, 7.271e-4),
        (REPETITION, 0.1, False, 2.75e-2),
        (HAMMING, 0.1, False, 4.252e-2),
        (GOLAY, 0.1, False, 1.699e-2),
        (REPETITION, 0.1, True, 7.25e-3),
        (HAMMING, 0.1, True, 1.943e-2),
        (GOLAY, 0.1, True, 8.018e-3),
    ],
)
def test_residual_bit_error_is_as_in_theory(
    code: PerfectCode, p: float, interleaved: bool, theory: float
) -> None:
    words = 200_000
    data = random_bits(words * code.k)
    sent = code.encode(data)
    if interleaved:
        sent = interleave(code, sent, data.size)
    received = dibit_channel(sent, p, SEED)
    if interleaved:
        received = deinterleave(code, received, data.size)
    got = code.decode(received, none_of(received.size), data.size)
    wrong = (got != data).reshape(words, code.k).mean(axis=1)
    standard_error = wrong.std() / np.sqrt(words / 2)  # neighbours may share a dibit
    assert abs(wrong.mean() - theory) < STANDARD_ERRORS * standard_error
    assert standard_error < theory / 10
