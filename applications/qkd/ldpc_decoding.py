"""LDPC reconciliation: one question for a syndrome, then belief propagation at this end.

The decoder is that of the library `ldpc` (Roffe, github.com/quantumgizmos/ldpc). If it
finds no error of the syndrome, the key keeps its errors and verification notices.

A regular code needs more checks than Cascade asks parities, but one round. There are enough
of them for the upper end of the confidence interval of the error rate.

Measured, means over 60, 40, 6 and 1 random keys with a sample of a ninth of their bits (f is
leak / n h(Q)); all were corrected, but for 6 of 300 and 3 of 200 of the
two shortest sizes:

    bits      Q = 0.5 %     1 %     3 %     5 %     8 %
                      f       f       f       f       f
    1,800         6.220   4.034   2.436   1.993   1.565
    9,000         3.234   2.483   1.848   1.709   1.505
    90,000        2.086   1.898   1.648   1.494   1.431
    900,000       1.852   1.784   1.544   1.476   1.381
"""

from math import ceil, log2

import numpy as np

from applications.qkd.bits import Bits, Indices
from applications.qkd.cascade import LEAST_QBER, Corrected, Questions
from applications.qkd.key_length import binary_entropy
from applications.qkd.parities import (
    LEAST_CHECKS,
    ROWS_OF_A_BIT,
    ReconciliationError,
    Syndrome,
    rows,
    syndrome,
)
from hosts.middleware.session.estimation import Estimate

CONFIDENCE = 0.95
MAX_ITERATIONS = 100


def checks_for(bits: int, estimate: Estimate) -> int:
    qber = min(max(estimate.interval(CONFIDENCE)[1], LEAST_QBER), 0.11)
    overhead = 1.3 + 0.1 * log2(0.12 / qber)
    return min(max(LEAST_CHECKS, ceil(overhead * bits * binary_entropy(qber))), bits - 1)


class LdpcDecoding:
    """The correcting end: `questions` yields the one question and is sent the answer."""

    def __init__(self, key: Bits, seed: bytes, estimate: Estimate) -> None:
        self._key = key
        self._seed = seed
        self._qber = max(estimate.qber, LEAST_QBER)
        self._checks = checks_for(key.size, estimate)
        self._errors = self._leaked = 0

    @property
    def result(self) -> Corrected:
        return Corrected(self._key, self._errors, self._leaked, 1)

    def questions(self) -> Questions:
        """Correct the key; the one item is a message to the other end, which answers it."""
        answer = yield Syndrome(self._checks)
        if answer.size != self._checks:
            raise ReconciliationError(f"a syndrome of {answer.size} bits, not {self._checks}")
        self._leaked = self._checks
        key = corrected(self._key, self._seed, answer, self._qber)
        self._errors = int(np.count_nonzero(key != self._key))
        self._key = key


def corrected(key: Bits, seed: bytes, answer: Bits, qber: float) -> Bits:
    """Return a key that has the other end's syndrome; as it is if no likely one is found."""
    code = rows(seed, key.size, answer.size)
    difference = answer ^ syndrome(key, code, answer.size)
    errors = _decode(code, difference, qber)
    if np.array_equal(syndrome(errors, code, answer.size), difference):
        return key ^ errors
    return key


def _decode(code: Indices, difference: Bits, qber: float) -> Bits:
    """Return the likeliest errors that belief propagation finds for a syndrome."""
    # Half a second to load, for which sessions with Cascade need not wait.
    from ldpc.bp_decoder import BpDecoder
    from scipy.sparse import csr_matrix

    columns = np.repeat(np.arange(len(code)), ROWS_OF_A_BIT)
    ones = np.ones(code.size, dtype=np.uint8)
    matrix = csr_matrix((ones, (code.ravel(), columns)), shape=(difference.size, len(code)))
    decoder = BpDecoder(matrix, error_rate=qber, max_iter=MAX_ITERATIONS, bp_method="product_sum")
    errors: Bits = np.asarray(decoder.decode(difference), dtype=np.uint8)
    return errors
