"""Ownership: a process that has the id of another is not that other."""

import os
import signal
import subprocess
from collections.abc import Iterator

import pytest

from topologies.system.processes.owners import (
    Owner,
    from_words,
    gone,
    owner,
    this_process,
)


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
