"""Random words by key and position: of many positions at once those of each, in little memory."""

import tracemalloc

import numpy as np

from wire.keyed import CACHED, KEY_BYTES, words

KEY = bytes(range(KEY_BYTES))


def test_words_of_many_positions_are_those_of_each() -> None:
    at = np.arange(5 * CACHED + 1)
    tracemalloc.start()
    drawn = words(KEY, at)
    most_bytes = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    for few in (slice(CACHED - 1, CACHED + 1), slice(-1, None), slice(0, None, CACHED)):
        assert np.array_equal(drawn[few], words(KEY, at[few]))
    assert most_bytes < 1.5 * drawn.nbytes  # what is computed meanwhile is of a part of them
