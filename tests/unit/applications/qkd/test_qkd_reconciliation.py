"""Error correction: what it corrects, what it tells, and how few rounds it takes."""

from functools import cache

import numpy as np
import pytest
from qkd_ends import random_bits

from applications.qkd.bits import Bits
from applications.qkd.cascade import Cascade, Corrected, long_passes, pass_sizes
from applications.qkd.key_length import binary_entropy
from applications.qkd.ldpc_decoding import LdpcDecoding
from applications.qkd.messages import AskBlocks, AskIntervals, AskSyndrome
from applications.qkd.parities import (
    Blocks,
    Intervals,
    Query,
    ReconciliationError,
    ReferenceKey,
    Syndrome,
    rows,
    shuffled,
    syndrome,
    to_message,
    to_query,
)
from hosts.middleware.session.estimation import Estimate

SEED = bytes(range(32))
SMALL = 3000


def reconcile(
    reference: ReferenceKey, corrector: Cascade | LdpcDecoding
) -> tuple[Corrected, list[Query]]:
    questions = corrector.questions()
    asked: list[Query] = []
    answer: Bits | None = None
    while True:
        try:
            query = next(questions) if answer is None else questions.send(answer)
        except StopIteration:
            return corrector.result, asked
        asked.append(query)
        answer = reference.answer(query)


def noisy(rng: np.random.Generator, size: int, qber: float) -> tuple[Bits, Bits]:
    key = random_bits(rng, size)
    return key, key ^ (rng.random(size) < qber).astype(np.uint8)


@pytest.mark.parametrize(
    ("size", "qber", "most", "rounds"),
    [
        (10_000, 0.01, 1.12, 230),  # 94 and 5 times their spread of 27
        (10_000, 0.03, 1.12, 100),
        (10_000, 0.1, 1.17, 80),
        (200_000, 0.03, 1.09, 150),
    ],
)
def test_cascade_corrects_all_errors_for_little_more_than_shannons_bound(
    size: int, qber: float, most: float, rounds: int
) -> None:
    rng = np.random.default_rng(1)
    sessions = 4
    count = 0
    for _ in range(sessions):
        key, other = noisy(rng, size, qber)
        reference = ReferenceKey(key, SEED)
        result, asked = reconcile(reference, Cascade(other, SEED, qber))
        assert np.array_equal(result.key, key)
        assert result.errors == np.count_nonzero(key != other)
        assert result.leaked_bits == reference.leaked_bits
        assert result.questions == len(asked) < rounds
        count += result.leaked_bits
    assert 1.0 < count / (sessions * size * binary_entropy(qber)) < most


@pytest.mark.by_day(every=3)
@pytest.mark.parametrize("size", [33, 50, 64, 100])
@pytest.mark.parametrize("qber", [0.0, 0.02, 0.3])
def test_cascade_finds_a_single_error_in_a_key_of_any_size(size: int, qber: float) -> None:
    key = random_bits(np.random.default_rng(size), size)
    for place in range(size):
        other = key.copy()
        other[place] ^= 1
        reference = ReferenceKey(key, SEED)
        result, _asked = reconcile(reference, Cascade(other, SEED, qber))
        assert np.array_equal(result.key, key)
        assert result.errors == 1


def test_no_parity_is_asked_for_that_follows_from_others_of_its_pass() -> None:
    rng = np.random.default_rng(2)
    key, other = noisy(rng, SMALL, 0.05)
    result, asked = reconcile(ReferenceKey(key, SEED), Cascade(other, SEED, 0.05))
    rows: dict[int, list[int]] = {}
    for query in asked:
        assert not isinstance(query, Syndrome)
        for number, start, stop in parts(query, SMALL):
            rows.setdefault(number, []).append(as_integer(number, start, stop))
    assert sum(len(some) for some in rows.values()) == result.leaked_bits > 800
    for number, some in rows.items():
        known = [] if number == 0 else [(1 << SMALL) - 1]  # pass 0 sent the parity of the whole
        assert rank(known + some) == len(known) + len(some)


def parts(query: Blocks | Intervals, size: int) -> list[tuple[int, int, int]]:
    if isinstance(query, Intervals):
        pairs = zip(query.starts.tolist(), query.stops.tolist(), strict=True)
        return [(query.number, start, stop) for start, stop in pairs]
    found = []
    for number in range(query.first, query.first + query.passes):
        starts = range(0, size, query.size)
        for start in starts if number == 0 else starts[:-1]:
            found.append((number, start, min(size, start + query.size)))
    return found


@cache
def order(number: int) -> list[int]:
    places: list[int] = shuffled(SEED, number, SMALL).tolist()
    return places


def as_integer(number: int, start: int, stop: int) -> int:
    return sum(1 << place for place in order(number)[start:stop])


def rank(rows: list[int]) -> int:
    pivots: dict[int, int] = {}
    for row in rows:
        while row and row.bit_length() in pivots:
            row ^= pivots[row.bit_length()]
        if row:
            pivots[row.bit_length()] = row
    return len(pivots)


def test_a_syndrome_corrects_what_its_code_can() -> None:
    rng = np.random.default_rng(6)
    key, other = noisy(rng, 20_000, 0.03)
    reference = ReferenceKey(key, SEED)
    result, asked = reconcile(reference, LdpcDecoding(other, SEED, Estimate(60, 2000)))
    assert np.array_equal(result.key, key)
    assert result.errors == np.count_nonzero(key != other)
    assert len(asked) == result.questions == 1
    assert result.leaked_bits == reference.leaked_bits
    assert result.leaked_bits < 2 * key.size * binary_entropy(0.03)


def test_too_many_errors_for_a_syndrome_leave_the_key_as_it_was() -> None:
    rng = np.random.default_rng(7)
    key, other = noisy(rng, 2000, 0.08)
    result, _asked = reconcile(
        ReferenceKey(key, SEED), LdpcDecoding(other, SEED, Estimate(30, 1000))
    )
    assert np.array_equal(result.key, other)
    assert result.errors == 0


def test_every_bit_is_in_three_checks_of_about_the_same_size() -> None:
    code = rows(SEED, 1000, 300)
    assert all(len(set(row)) == 3 for row in code.tolist())
    sizes = np.bincount(code.ravel(), minlength=300)
    assert sizes.min() >= 6
    assert sizes.max() <= 14
    with pytest.raises(ValueError, match="7 checks, at least 8"):
        rows(SEED, 1000, 7)


def test_a_syndrome_is_the_product_of_code_and_key() -> None:
    code = rows(SEED, 60, 20)
    key = random_bits(np.random.default_rng(8), 60)
    matrix = np.zeros((20, 60), dtype=np.int64)
    for column, ones in enumerate(code):
        matrix[ones, column] = 1
    assert np.array_equal(syndrome(key, code, 20), matrix @ key % 2)


def test_blocks_are_as_long_as_errors_are_rare() -> None:
    assert pass_sizes(100_000, 0.03) == [32, 64, 256]
    assert pass_sizes(100_000, 0.0) == pass_sizes(100_000, 0.001) == [1024, 2048, 8192]
    assert pass_sizes(100, 0.001) == [50, 50, 50]
    assert long_passes(1000) == (11, 500)
    assert long_passes(1 << 20) == (2, 8192)


@pytest.mark.parametrize(
    "query",
    [
        Blocks(0, 1, 0),
        Blocks(0, 1, 101),
        Blocks(0, 0, 10),
        Blocks(64, 1, 10),
        Blocks(60, 10, 100),
        Intervals(0, np.array([5]), np.array([5])),
        Intervals(0, np.array([5]), np.array([101])),
        Intervals(64, np.array([5]), np.array([6])),
        Syndrome(7),
        Syndrome(100),
    ],
)
def test_questions_that_nobody_asks_are_refused(query: Query) -> None:
    reference = ReferenceKey(random_bits(np.random.default_rng(3), 100), SEED)
    with pytest.raises(ReconciliationError):
        reference.answer(query)


def test_a_reference_key_never_tells_more_than_it_is_long() -> None:
    reference = ReferenceKey(random_bits(np.random.default_rng(4), 100), SEED)
    reference.answer(Blocks(0, 1, 1))
    with pytest.raises(ReconciliationError, match="more parities asked for than the 100 bits"):
        reference.answer(Intervals(1, np.array([0]), np.array([1])))


def test_an_answer_of_another_size_is_refused() -> None:
    questions = Cascade(random_bits(np.random.default_rng(5), 100), SEED, 0.03).questions()
    next(questions)
    with pytest.raises(ReconciliationError, match="1 parities in answer to 4 questions"):
        questions.send(np.zeros(1, dtype=np.uint8))


def test_parities_of_no_key_do_not_keep_cascade_busy_for_ever() -> None:
    ends = []
    for number in range(20):
        rng = np.random.default_rng(number)
        cascade = Cascade(random_bits(rng, 300), SEED, 0.1)
        questions = cascade.questions()
        query = next(questions)
        reference = ReferenceKey(random_bits(rng, 300), SEED)
        try:
            while True:
                reference.leaked_bits = 0
                query = questions.send(random_bits(rng, reference.answer(query).size))
        except (ReconciliationError, StopIteration) as end:
            ends.append(type(end))
    assert ReconciliationError in ends


@pytest.mark.parametrize(
    "query",
    [
        Blocks(3, 11, 8192),
        Intervals(7, np.array([0, 1 << 20]), np.array([1, (1 << 20) + 4096])),
        Syndrome(1000),
    ],
)
def test_a_question_survives_the_wire(query: Query) -> None:
    message = to_message(query)
    assert isinstance(message, AskBlocks | AskIntervals | AskSyndrome)
    again = to_query(type(message).parse(message.encode()))  # type: ignore[arg-type]
    assert repr(again) == repr(query)
