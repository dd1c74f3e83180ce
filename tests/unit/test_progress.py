"""How long the rest takes: of the tests, and of the first set-up."""

import os
import re
import subprocess
from pathlib import Path

import pytest
from progress import left

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.parametrize(
    ("done", "total", "elapsed_s", "words"),
    [(50, 200, 60.0, "3 min"), (100, 200, 30.0, "30 s"), (199, 200, 1990.0, "10 s")],
)
def test_the_rest_is_expected_to_go_on_alike(
    done: int, total: int, elapsed_s: float, words: str
) -> None:
    assert left(done, total, elapsed_s) == words


def followed(total: str, *said: str, every_s: str = "0") -> list[str]:
    """Return what set-up tells of an installation whose program has said this."""
    done = subprocess.run(
        [ROOT / "setup" / "following", total],
        input="".join(f"{line}\n" for line in said),
        env={**os.environ, "EVERY_S": every_s},
        capture_output=True,
        text=True,
        check=True,
    )
    return done.stdout.splitlines()


def test_set_up_tells_how_many_packages_are_left() -> None:
    said = (
        "Collecting a==1",
        "  Downloading a",
        "Collecting b==2",
        "Installing collected packages",
    )
    first, second, last = followed("3", *said)
    assert re.fullmatch(r"setup: 1 of 3 Python packages fetched, about \d+ s left", first)
    assert re.fullmatch(r"setup: 2 of 3 Python packages fetched, about \d+ s left", second)
    assert last == "setup: installing 3 Python packages"
    assert followed("3", *said, every_s="1000") == [last]  # not all the time
