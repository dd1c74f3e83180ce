"""A run that is under way, as its user sees it: what it says and when, and the phases of its life.

    loading | start | session | report, with the clean-up | end

Each begins with words that a run says. A moment is drawn as a phase and a share of its length; so
what is struck does not depend on how long a run takes on this machine, now or in a year.
"""

import errno
import fcntl
import os
import pty
import select
import subprocess
import termios
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
PIPE, TERMINAL, DISK = OUTPUTS = ("pipe", "terminal", "disk")  # where a run writes
DISK_BYTES = 1 << 16


def _take_terminal() -> None:
    """Make standard input the terminal of this session."""
    fcntl.ioctl(0, termios.TIOCSCTTY, 0)


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

    def __init__(self, command: list[str], output: str = PIPE, disk: Path | None = None) -> None:
        """Start it; `disk` is an empty folder for a small file system, if it writes to a disk."""
        self.output, self._disk = output, disk
        self._reads, writes = self._opened()
        self._lost = threading.Event()
        self._process = subprocess.Popen(
            command,
            cwd=ROOT,
            # A dumb terminal shows progress as a pipe does: at the end.
            env={**os.environ, "PYTHONUNBUFFERED": "1", "TERM": "dumb"},
            stdin=writes if output == TERMINAL else None,
            stdout=writes,
            stderr=subprocess.STDOUT,
            start_new_session=output == TERMINAL,
            preexec_fn=_take_terminal if output == TERMINAL else None,
        )
        os.close(writes)
        self.pid = self._process.pid
        self.lines: list[tuple[float, str]] = []
        self.slowed = 1.0  # by others that want the same processor
        self._begun = [time.monotonic()]  # each phase
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _opened(self) -> tuple[int, int]:
        """Return where to read what the run writes, and where it writes."""
        if self.output == TERMINAL:
            return pty.openpty()
        if self.output == PIPE:
            return os.pipe()
        machine.run("mount", "-t", "tmpfs", "-o", f"size={DISK_BYTES}", "tmpfs", str(self._disk))
        file = f"{self._disk}/output"
        writes = os.open(file, os.O_WRONLY | os.O_CREAT | os.O_APPEND)
        return os.open(file, os.O_RDONLY), writes

    def lose_output(self) -> None:
        """Close the terminal, or the pipe, or fill the disk that the run writes to."""
        self._lost.set()
        if self.output == DISK:
            os.truncate(f"{self._disk}/output", 0)  # its last page would have room
            machine.fill(Path(f"{self._disk}/filler"))
        self._reader.join()

    def _read(self) -> None:
        left = b""
        while part := self._part():
            *lines, left = (left + part).split(b"\n")
            for line in lines:
                self._note(line.decode(errors="replace"))
        os.close(self._reads)

    def _part(self) -> bytes:
        """Return what the run has written, nothing at its end or when its output is lost."""
        while not self._lost.is_set():
            ended = not self.running
            try:
                ready = self.output == DISK or select.select([self._reads], [], [], LOOK_S)[0]
                if part := os.read(self._reads, 1 << 16) if ready else b"":
                    return part
            except OSError as error:
                if error.errno != errno.EIO:  # the run has closed its terminal
                    raise
                return b""
            if ended or (ready and self.output != DISK):
                return b""
            time.sleep(LOOK_S)
        return b""

    def _note(self, line: str) -> None:
        now = time.monotonic()
        self.lines.append((now, line.strip()))
        self.slowed = machine.slowed(machine.runner_of(self.pid)) or self.slowed
        for number in range(len(self._begun), len(NAMES)):
            if any(words in line for words in PHASES[NAMES[number]]):
                self._begun += [now] * (number + 1 - len(self._begun))
                break

    @property
    def output_lost(self) -> bool:
        """Whether it can write no more."""
        return self._lost.is_set()

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
        if self.output == DISK:
            machine.run("umount", str(self._disk))
        return status

    def lengths(self) -> dict[str, float]:
        """Return how long each phase of a run took that has just ended; seconds."""
        ends = [*self._begun[1:], time.monotonic()]
        return {
            name: end - begin for name, begin, end in zip(NAMES, self._begun, ends, strict=True)
        }
