"""Outputs that nobody takes: the exit status is not 0, there is no traceback, clean-up is done."""

import errno
import fcntl
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest
from limits import SOON_S

from topologies.system.processes import outputs

ROOT = Path(__file__).parents[3]
QMN = [sys.executable, "-m", "qmn"]
# Writes 1 MiB, sixteen times what a pipe of Linux holds (pipe(7)), and cleans up.
WRITES = """
import sys
from topologies.system.processes import outputs
from topologies.system.processes.signals import Interrupted, Signals

def work():
    try:
        with Signals():
            sys.stdout.write("x" * (1 << 20))
    except Interrupted as error:
        return error.status
    finally:
        print("cleaned up")  # dropped
        print("cleaned up", file=sys.stderr)
    return 0

outputs.OUTPUT_TIMEOUT_S = float(sys.argv[1])
sys.exit(outputs.with_outputs(work))
"""


@pytest.fixture(params=[True, False], ids=["blocking", "non-blocking"])
def pipe(request: pytest.FixtureRequest) -> Iterator[tuple[int, int]]:
    """Give a pipe, to read from and to write to."""
    reads, writes = os.pipe()
    os.set_blocking(writes, request.param)
    with ExitStack() as stack:
        stack.callback(os.close, reads)
        yield reads, writes


def begun(pipe: tuple[int, int], timeout_s: float) -> "subprocess.Popen[str]":
    """Start to write to a pipe."""
    command = [sys.executable, "-c", WRITES, str(timeout_s)]
    process = subprocess.Popen(command, cwd=ROOT, stdout=pipe[1], stderr=subprocess.PIPE, text=True)
    os.close(pipe[1])
    return process


def wait_until_full(reads: int) -> None:
    """Wait until a pipe has all that it holds."""
    deadline, held = time.monotonic() + 60, bytearray(4)
    size = fcntl.fcntl(reads, fcntl.F_GETPIPE_SZ)
    while int.from_bytes(held, sys.byteorder) < size:
        assert time.monotonic() < deadline
        fcntl.ioctl(reads, 0x541B, held)  # FIONREAD of asm-generic/ioctls.h
        time.sleep(0.01)


def test_a_reader_that_pauses_gets_all(pipe: tuple[int, int]) -> None:
    with begun(pipe, 60.0) as process:
        wait_until_full(pipe[0])
        got = 0
        while part := os.read(pipe[0], 1 << 16):
            got += len(part)
        assert (process.wait(SOON_S), got) == (0, (1 << 20) + len("cleaned up\n"))


def test_a_pipe_that_nobody_reads_ends_the_work_after_a_while(pipe: tuple[int, int]) -> None:
    with begun(pipe, 0.2) as process:
        assert process.wait(SOON_S) == 1
        assert process.stderr is not None
        lines = process.stderr.read().splitlines()
    assert lines == ["cleaned up", "qmn: standard output cannot be written: nobody reads it"]


def test_a_signal_ends_the_wait_for_a_full_pipe(pipe: tuple[int, int]) -> None:
    with begun(pipe, 60.0) as process:
        wait_until_full(pipe[0])
        process.send_signal(signal.SIGINT)
        assert process.wait(SOON_S) == 128 + signal.SIGINT
        assert process.stderr is not None
        assert process.stderr.read() == "cleaned up\n"


@pytest.mark.by_day(every=3)
@pytest.mark.parametrize("words", [["--help"], ["lab"], ["runs", "--json"]])
@pytest.mark.parametrize(
    ("outputs", "status", "why"),
    [
        (">/dev/full", 1, os.strerror(errno.ENOSPC)),
        (">&-", 1, os.strerror(errno.EBADF)),
        (">&- 2>&- <&-", 1, ""),
        (">/dev/full 2>&1", 1, ""),
        ("2>/dev/full", 0, ""),
        ("| true", 128 + signal.SIGPIPE, ""),
    ],
)
def test_every_verb_has_the_same_rule(
    tmp_path: Path, words: list[str], outputs: str, status: int, why: str
) -> None:
    shell = f'set -o pipefail; "$@" {outputs}'
    if words == ["runs", "--json"]:
        words = [*words, "--runs", str(tmp_path)]
    done = subprocess.run(
        ["bash", "-c", shell, "bash", *QMN, *words],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=SOON_S,
        check=False,
    )
    text = f"qmn: standard output cannot be written: {why}\n" if why else ""
    assert (done.returncode, done.stderr) == (status, text)


@pytest.mark.parametrize(
    ("columns", "width"), [("0", None), ("²", None), ("-1", None), ("80", "80")]
)
def test_a_width_that_is_none_is_forgotten(
    columns: str, width: str | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", columns)
    outputs.forget_no_width()
    assert os.environ.get("COLUMNS") == width


@pytest.mark.nightly
@pytest.mark.parametrize("columns", ["0", "²"])
def test_a_width_that_is_none_is_no_width(columns: str) -> None:
    def shown(environment: dict[str, str]) -> str:
        return subprocess.check_output([*QMN, "lab"], cwd=ROOT, env=environment, text=True)

    others = {name: value for name, value in os.environ.items() if name != "COLUMNS"}
    assert shown({**others, "COLUMNS": columns}) == shown(others) != ""
