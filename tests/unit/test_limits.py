"""Tests end by seconds of a machine that has time for them; the wall only guards."""

import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest
from limits import SOON_S, left_s
from machine import slowed

PYTEST = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-p", "limits"]
SHARING = 3  # processes of one processor


@contextmanager
def sharing() -> Iterator[list[int]]:
    """Let processes compute on one processor; give their ids."""
    (here, *_others) = os.sched_getaffinity(0)
    code = f"import os\nos.sched_setaffinity(0, [{here}])\nwhile True: pass"
    with ExitStack() as stack:
        programs = [subprocess.Popen([sys.executable, "-S", "-c", code]) for _ in range(SHARING)]
        for program in programs:
            stack.enter_context(program)
            stack.callback(program.kill)
        yield [program.pid for program in programs]


def ran_s(pid: int) -> float:
    return int(Path(f"/proc/{pid}/schedstat").read_text().split()[0]) / 1e9


def test_who_shares_a_processor_is_as_slow_as_they_are_many() -> None:
    """The kernel deals it out fairly: each waits while the others run, and for others still."""
    with sharing() as pids:
        while min(map(ran_s, pids)) < 0.3:
            time.sleep(0.01)
        slower = slowed(*pids)
    assert slower is not None
    assert slower > 0.9 * SHARING
    assert slowed(*pids) is None  # they are gone


@pytest.mark.parametrize(
    ("passed_s", "least_s", "most_s"),
    [(10, 90, 90), (90, 10, 10), (110, -10, 490), (700, -600, -100)],
)
def test_a_wait_has_its_seconds_and_more_only_for_those_without_a_processor(
    passed_s: float, least_s: float, most_s: float
) -> None:
    more_s = left_s(time.monotonic() - passed_s, 100.0)
    assert least_s - 1 < more_s <= most_s


def test_a_test_that_hangs_fails_by_its_limit_long_before_the_guard(tmp_path: Path) -> None:
    limit_s = 0.5
    (tmp_path / "test_it.py").write_text(f"import time\ndef test_it(): time.sleep({SOON_S})\n")
    done = subprocess.run(
        [*PYTEST, f"--timeout={limit_s}", "test_it.py"],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
        capture_output=True,
        text=True,
        timeout=SOON_S,
        check=False,
    )
    assert "1 failed" in done.stdout, done.stderr
    assert f"Failed: has not ended in {limit_s} s" in done.stdout
