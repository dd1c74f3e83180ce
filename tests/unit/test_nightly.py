"""The cases that are left to the night: every value of each parameter is tried by day."""

import subprocess
import sys
from pathlib import Path

TESTS = Path(__file__).resolve().parents[1]
CASES = """
import pytest
@pytest.mark.by_day(every=3)
@pytest.mark.parametrize("fast", range(3))
@pytest.mark.parametrize(("slow", "more"), [(n, "") for n in range(6)])
def test_one(slow, more, fast):
    pass
"""


def test_each_value_of_each_parameter_is_tried_by_day(tmp_path: Path) -> None:
    (tmp_path / "test_it.py").write_text(CASES)
    (tmp_path / "pytest.ini").write_text("[pytest]\nmarkers =\n  nightly\n  by_day\n")
    command = [sys.executable, "-m", "pytest", "-q", "-p", "nightly", "-p", "no:cacheprovider"]
    done = subprocess.run(
        [*command, "-m", "not nightly", "--collect-only"],
        cwd=tmp_path,
        env={"PYTHONPATH": str(TESTS)},
        capture_output=True,
        text=True,
        check=True,
    )
    expected = {f"test_it.py::test_one[{n}--{m}]" for n in range(6) for m in range(3)}
    expected = {name for name in expected if (int(name[21]) + int(name[24])) % 3 == 0}
    assert {line for line in done.stdout.splitlines() if "::" in line} == expected
    assert len(expected) == 6
