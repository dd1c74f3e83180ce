"""A run that is under way, as its user sees it: what it says and when, and the phases of its life.

    loading | start | session | report, with the clean-up | end

Each begins with words that a run says. A moment is drawn as a phase and a share of its length; so
what is struck does not depend on how long a run takes on this machine, now or in a year.
"""

import os
import subprocess
import threading
import time
from dataclasses import dataclass
from pathlib import Path
from random import Random

import machine

ROOT = Path(__file__).resolve().parents[2]
LOOK_S = 0.005  # between two looks whether a moment has come
PHASES = {  # the words with which each begins, by what is done
    "loading": ("",),
    "start": ("starting the network",),
    "session": (
        " from alice to bob",
        " of alice, bob, charlie",
        " between alice and bob",
        "https:",
    ),
    "report": ("━", "downloaded: "),  # the last of the progress; the network is taken down first
    "end": ("all facts",),
}
NAMES = tuple(PHASES)
WEIGHTS = (1, 6, 8, 6, 1)


@dataclass(frozen=True)
class Moment:
    """When a run is struck."""

    phase: str
    share: float  # of the length that the phase had in a run that was not struck


def drawn(random: Random) -> Moment:
    """Return a moment in the life of a run."""
    (phase,) = random.choices(NAMES, WEIGHTS)
    return Moment(phase, round(random.random(), 3))


class UnderWay:
    """A run, from its start to its end; notes what it says, and when."""

    def __init__(self, command: list[str]) -> None:
        self._process = subprocess.Popen(
            command,
            cwd=ROOT,
            env={**os.environ, "PYTHONUNBUFFERED": "1"},
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        self.pid = self._process.pid
        self.said: list[tuple[float, str]] = []
        self.slowed = 1.0  # by others that want the same processor
        self._begun = [time.monotonic()]  # each phase
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            now = time.monotonic()
            self.said.append((now, line.strip()))
            self.slowed = machine.slowed(self.pid) or self.slowed
            for number in range(len(self._begun), len(NAMES)):
                if any(words in line for words in PHASES[NAMES[number]]):
                    self._begun += [now] * (number + 1 - len(self._begun))
                    break

    @property
    def running(self) -> bool:
        """Whether it has not ended."""
        return self._process.poll() is None

    @property
    def phase(self) -> str:
        """The phase that it is in."""
        return NAMES[len(self._begun) - 1]

    def wait_until(self, moment: Moment, lengths: dict[str, float]) -> None:
        """Wait for a moment, or the end of its phase, or of the run."""
        wanted = NAMES.index(moment.phase)
        while self.running and len(self._begun) <= wanted:
            time.sleep(LOOK_S)
        if len(self._begun) == wanted + 1:
            due = self._begun[wanted] + moment.share * lengths[moment.phase]
            while self.running and len(self._begun) == wanted + 1 and time.monotonic() < due:
                time.sleep(LOOK_S)

    def wait(self, duration_s: float) -> None:
        """Wait for so long, or until its end."""
        due = time.monotonic() + duration_s
        while self.running and time.monotonic() < due:
            time.sleep(LOOK_S)

    def end(self, timeout_s: float) -> int | None:
        """Wait for its end; return the status, None for one that hangs, which is killed."""
        try:
            status = self._process.wait(timeout_s)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
            status = None
        self._reader.join(5)
        return status

    def lengths(self) -> dict[str, float]:
        """Return how long each phase of a run took that has just ended; seconds."""
        ends = [*self._begun[1:], time.monotonic()]
        return {
            name: end - begin for name, begin, end in zip(NAMES, self._begun, ends, strict=True)
        }
