"""`qmn run seal` from outside: a fibre that is watched, and somebody who measures on it."""

import json
from math import sqrt
from pathlib import Path
from typing import Any

import pytest
from loaded import run_qmn

NOISE = 0.002


def sealed(runs: Path, *words: str) -> dict[str, Any]:
    """Watch; return the result."""
    done = run_qmn("run", "seal", "--depolarizing", str(NOISE), *words, "--runs", str(runs))
    assert done.returncode == 0, done.stdout + done.stderr
    result: dict[str, Any] = json.loads((runs / "latest" / "result.json").read_text())
    return {**result["job"]["asking"], "eve": result["job"]["eve"]}


@pytest.mark.by_day(every=2)
@pytest.mark.parametrize("eve", [0.5, None])
def test_the_seal_is_broken_by_who_measures_on_the_fibre(tmp_path: Path, eve: float | None) -> None:
    report = sealed(tmp_path, *([] if eve is None else ["--eve", str(eve)]))
    assert report["alarm"] is (eve is not None)
    if eve is None:
        error = (1 - (1 - NOISE) ** 4) / 2
        assert report["compared"] >= 10_000
        assert abs(report["error_rate"] - error) < 5 * sqrt(error / report["compared"])
    else:
        assert report["compared"] < 1000  # 74 on average
        assert report["eve"]["measured"] > 0
