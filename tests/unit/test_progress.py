"""How long the rest of the tests takes."""

import pytest
from progress import left


@pytest.mark.parametrize(
    ("done", "total", "elapsed_s", "words"),
    [(50, 200, 60.0, "3 min"), (100, 200, 30.0, "30 s"), (199, 200, 1990.0, "10 s")],
)
def test_the_rest_is_expected_to_go_on_alike(
    done: int, total: int, elapsed_s: float, words: str
) -> None:
    assert left(done, total, elapsed_s) == words
