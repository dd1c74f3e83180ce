"""A machine's limits, each as one line: what is at its limit, and what to do."""

import errno
import os
import subprocess
import sys
from pathlib import Path

import pytest

from qmn.machine_limits import limit_met

ROOT = Path(__file__).parents[3]


@pytest.mark.parametrize(
    ("number", "remedy"),
    [
        (errno.ENOSPC, "make room there"),
        (errno.EROFS, "mount it to be written to"),
        (errno.EMFILE, "`ulimit -n`"),
        (errno.ENFILE, "fs.file-max"),
        (errno.EDQUOT, "quota"),
        (errno.ENOMEM, "memory"),
        (errno.EAGAIN, "`ulimit -u`"),
        (errno.ENODEV, "an interface was deleted"),
    ],
)
def test_a_limit_is_named_with_its_remedy(number: int, remedy: str) -> None:
    """As errno(3) words them."""
    text = limit_met(OSError(number, os.strerror(number), "/run/qmn"))
    assert text.startswith(f"/run/qmn: {os.strerror(number)}: ")
    assert remedy in text


@pytest.mark.parametrize("number", [errno.ENOENT, errno.EACCES, errno.EINVAL, errno.ECONNRESET])
def test_another_fault_is_no_limit(number: int) -> None:
    assert limit_met(OSError(number, os.strerror(number))) == ""


def test_a_verb_that_meets_one_ends_in_one_line(tmp_path: Path) -> None:
    code = f"""
import errno, sys
from qmn import __main__
from views.verbs import runs
def full(_arguments):
    raise OSError(errno.EROFS, "Read-only file system", "{tmp_path}")
runs.call = full
sys.argv = ["qmn", "runs"]
sys.exit(__main__.main())
"""
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False
    )
    text = f"qmn: {tmp_path}: Read-only file system: mount it to be written to, or name another"
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr == f"{text} folder\n"
