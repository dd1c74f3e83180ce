"""Ownership: a process that has the id of another is not that other."""

import os
import signal
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from topologies.system.processes.owners import (
    VARIABLE,
    Owner,
    end,
    end_marked,
    from_words,
    gone,
    marked,
    owner,
    this_process,
)

RUN = "4711-1-00000000"  # of another boot


@pytest.fixture
def sleeper() -> Iterator[subprocess.Popen[bytes]]:
    with subprocess.Popen(["sleep", "60"]) as process:
        yield process
        process.kill()


def test_a_process_is_found_again_by_its_words() -> None:
    mine = this_process()
    assert mine.pid == os.getpid()
    assert from_words(str(mine)) == mine
    assert mine.alive
    assert not gone(str(mine))


@pytest.mark.parametrize(
    "other",
    [
        lambda mine: mine._replace(start=mine.start - 1),  # its id was given again
        lambda mine: mine._replace(boot="00000000"),  # the machine has been started again
    ],
)
def test_another_process_with_the_same_id_is_not_the_owner(other: object) -> None:
    assert callable(other)
    previous: Owner = other(this_process())
    assert not previous.alive
    assert gone(str(previous))
    previous.signal(signal.SIGKILL)  # does not reach us


@pytest.mark.parametrize("words", ["", "tests", "4711", "lock", "4711-1", "../etc", "1-2-0123456"])
def test_what_is_not_the_name_of_a_run_is_never_gone(words: str) -> None:
    assert from_words(words) is None
    assert not gone(words)


def test_one_that_nobody_has_waited_for_is_not_alive(sleeper: subprocess.Popen[bytes]) -> None:
    found = owner(sleeper.pid)
    assert found is not None
    sleeper.kill()
    os.waitid(os.P_PID, sleeper.pid, os.WEXITED | os.WNOWAIT)
    assert found.state == "Z"
    assert not found.alive


def test_one_that_is_stopped_is_ended_all_the_same(sleeper: subprocess.Popen[bytes]) -> None:
    found = owner(sleeper.pid)
    assert found is not None
    sleeper.send_signal(signal.SIGSTOP)
    os.waitid(os.P_PID, sleeper.pid, os.WSTOPPED | os.WNOWAIT)
    assert found.stopped
    end([found])
    assert sleeper.wait(10) == -signal.SIGTERM


@contextmanager
def of_a_run(script: str) -> Iterator[subprocess.Popen[bytes]]:
    """Start a shell that carries the mark of a run."""
    environment = {**os.environ, VARIABLE: RUN}
    command = ["sh", "-c", script]
    with subprocess.Popen(command, env=environment, stdout=subprocess.PIPE) as process:
        try:
            yield process
        finally:
            process.kill()


def pids() -> set[int]:
    return {process.pid for process, words in marked() if words == RUN}


def test_one_that_becomes_another_program_is_found_all_the_while(tmp_path: Path) -> None:
    """The kernel shows no environment of it for a moment, here a tenth of the time."""
    again = tmp_path / "again"
    again.write_text(f"exec sh {again}\n")
    with of_a_run(f"exec sh {again}") as process:
        assert [pids() for _ in range(100)] == [{process.pid}] * 100


def test_what_is_started_meanwhile_is_ended_too() -> None:
    with of_a_run("trap 'sleep 60 & exit' TERM; echo ready; while :; do :; done") as process:
        assert process.stdout is not None
        process.stdout.readline()
        end_marked(lambda words: words == RUN)
        assert pids() == set()
