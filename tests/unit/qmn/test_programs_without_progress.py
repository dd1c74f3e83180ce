"""A run that stands still says what is known, blaming no light that was not lost."""

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from qmn.jobs import calls
from qmn.jobs.transfer import follow_all
from topologies.networks.network import Network
from topologies.system.processes.programs import NetworkError, Program
from wire.network_time import PAGE, PAGE_BYTES, NetworkTime, SteppedTime
from wire.results.run_result import ServiceJob

WAIT_S = 1.0
LISTENING = '{"event": "listening", "port": 7}'
LOST = '{"event": "result", "bell_pairs": 4000, "lost_pairs": 3900}'
WHOLE = '{"event": "result", "bell_pairs": 4000, "lost_pairs": 0}'


class Standing:
    """A network in which nothing is wrong; one of our own would need root."""

    runtime = SimpleNamespace(time=NetworkTime(1.0))

    def check(self) -> None:
        """Raise nothing: all its programs run."""

    explain = check


class Stepping(Standing):
    """One whose time is stepped: a page that nobody but `step` writes to."""

    def __init__(self, folder: Path) -> None:
        (folder / PAGE).write_bytes(bytes(PAGE_BYTES))
        self.runtime = SimpleNamespace(time=SteppedTime(1.0, 0, str(folder)))

    def step(self, seconds: float) -> None:
        """Step the clock."""
        self.runtime.time.page[0] += round(seconds * 1e9)


@contextmanager
def standing_still(folder: Path, name: str, *lines: str) -> Iterator[Program]:
    """Yield a program that has printed these lines, and waits."""
    program = Program(name, folder / f"{name}.log")
    text = "; ".join(f"print({line!r}, flush=True)" for line in lines)
    program.start([sys.executable, "-c", f"import time; {text or 'pass'}; time.sleep(60)"])
    try:
        yield program
    finally:
        program.stop()


def why(*programs: Program, network: Any = None, look: Callable[[], None] = lambda: None) -> str:
    """Return why following the programs ends."""
    found = cast("Network", network or Standing())
    with pytest.raises(NetworkError) as raised:
        follow_all(found, programs, lambda *_fields: None, look, WAIT_S)
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


def test_a_stepped_clock_that_stands_ends_the_run(tmp_path: Path) -> None:
    with standing_still(tmp_path, "asking") as program:
        assert "no progress for 1 s" in why(program, network=Stepping(tmp_path))


def test_a_stepped_clock_that_goes_slowly_has_a_second_of_its_own(tmp_path: Path) -> None:
    """By a quarter of the wall, at most: the limit of one second comes behind four of the wall."""
    network, began_s = Stepping(tmp_path), time.monotonic()

    def look() -> None:
        ahead_s = (time.monotonic() - began_s) / 4 - network.runtime.time.now_s()
        network.step(max(ahead_s, 0.0))

    with standing_still(tmp_path, "asking") as program:
        why(program, network=network, look=look)
    assert time.monotonic() - began_s > 4 * WAIT_S


def test_a_session_of_calls_has_its_seconds_of_a_stepped_clock(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(calls, "STALL_TIMEOUT_S", WAIT_S / 4)
    network = Stepping(tmp_path)
    progress = calls.Progress(cast("Network", network), ServiceJob(), lambda: None)
    progress.note({})
    time.sleep(WAIT_S / 2)  # longer than the limit, by the wall
    network.step(WAIT_S / 8)
    progress.look()
    network.step(WAIT_S / 4)
    with pytest.raises(NetworkError, match="the session made no progress for"):
        progress.look()


def test_programs_that_go_on_speaking_have_all_the_time_that_they_need(tmp_path: Path) -> None:
    """Five words, each within the limit, take twice as long as it."""
    program = Program("asking", tmp_path / "asking.log")
    word, done = 'print(\'{"event": "result"}\', flush=True)', 'print(\'{"event": "done"}\')'
    code = f"import time\nfor _ in range(5):\n {word}\n time.sleep({0.4 * WAIT_S})\n{done}"
    program.start([sys.executable, "-c", code])
    try:
        network = cast("Network", Standing())
        last = follow_all(network, [program], lambda *_fields: None, lambda: None, WAIT_S)
    finally:
        program.stop()
    assert last == {"asking": {"event": "done"}}
