"""A run that stands still says what is known, blaming no light that was not lost."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from qmn.jobs.transfer import follow_all
from topologies.networks.network import Network
from topologies.system.processes.programs import NetworkError, Program
from wire.network_time import NetworkTime

WAIT_S = 1.0
LISTENING = '{"event": "listening", "port": 7}'
LOST = '{"event": "result", "bell_pairs": 4000, "lost_pairs": 3900}'
WHOLE = '{"event": "result", "bell_pairs": 4000, "lost_pairs": 0}'


class Standing:
    """A network in which nothing is wrong; one of our own would need root."""

    runtime = SimpleNamespace(time=NetworkTime(1.0))

    def check(self) -> None:
        """Raise nothing: all its programs run."""


@contextmanager
def standing_still(folder: Path, name: str, *lines: str) -> Iterator[Program]:
    """Yield a program that has printed these lines, and waits."""
    program = Program(name, folder / f"{name}.log")
    said = "; ".join(f"print({line!r}, flush=True)" for line in lines)
    program.start([sys.executable, "-c", f"import time; {said or 'pass'}; time.sleep(60)"])
    try:
        yield program
    finally:
        program.stop()


def why(*programs: Program) -> str:
    """Return why following the programs ends."""
    network: Any = Standing()
    with pytest.raises(NetworkError) as raised:
        follow_all(cast("Network", network), programs, lambda *_fields: None, lambda: None, WAIT_S)
    return str(raised.value)


def test_light_that_was_lost_is_blamed(tmp_path: Path) -> None:
    with standing_still(tmp_path, "asking", LISTENING, LOST) as program:
        text = why(program)
    assert text == (
        "asking made no progress for 1 s; 3,900 of 4,000 pairs were lost: "
        "is the loss of the fibres too high?"
    )


def test_light_is_not_blamed_where_none_was_lost(tmp_path: Path) -> None:
    with (
        standing_still(tmp_path, "asking", WHOLE) as asking,
        standing_still(tmp_path, "asked", LISTENING) as asked,
        standing_still(tmp_path, "silent") as silent,
    ):
        text = why(asking, asked, silent)
    assert "loss" not in text
    assert text == (
        "asking, asked, silent made no progress for 1 s; no host reported lost light; last "
        "reports: asking: result (bell_pairs 4,000, lost_pairs 0), asked: listening (port 7), "
        "silent: nothing yet"
    )
