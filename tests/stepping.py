"""A gate in a process of its own, which looks at a test and at what that starts."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

from limits import SOON_S

from gate.timeouts import HELD_S
from wire.network_time import SteppedTime

DEADLINE_S = SOON_S
SINCE_NS = 1_700_000_000_000_000_000
# Counts a leap as wrong, too, if work has begun that is not over (file `work`: pairs of counts).
GATE = """
import mmap, signal, sys
from pathlib import Path
import gate.gate
from tempfile import TemporaryDirectory
from gate.gate import Gate
from gate.quiescence import Quiescence
from wire.leaps import LEAPS

with open(sys.argv[1] + "/work", "w+b") as file:
    file.truncate(mmap.PAGESIZE)
    work = memoryview(mmap.mmap(file.fileno(), mmap.PAGESIZE)).cast("q")

class Counting(Gate):
    def _go_on(self):
        self.wrong += sum(work[::2]) != sum(work[1::2])
        super()._go_on()

folder, since, proc, held, *watched = sys.argv[1:]
gate.gate.HELD_S = float(held)
leaps, quiet = Path(folder, LEAPS), Quiescence(proc)
counting = Counting(Path(folder), int(since), leaps, quiet, bool(watched))
signal.signal(signal.SIGTERM, lambda *_: counting.stop())
print("ready", flush=True)
counting.run()
print(counting.leaps, counting.wrong)
"""


class Stepping:
    """A running gate."""

    def __init__(self, folder: Path, watched: bool = False, held_s: float = HELD_S) -> None:
        self.time = SteppedTime(1.0, SINCE_NS, str(folder))
        self._proc = folder / "proc"
        self._proc.mkdir()
        (self._proc / "net").symlink_to("/proc/net")
        self._newest = os.open(self._proc / "loadavg", os.O_RDWR | os.O_CREAT)
        self._show_newest(0)
        command = [sys.executable, "-c", GATE, str(folder), str(SINCE_NS), str(self._proc)]
        command.append(str(held_s))
        command += ["watched"] * watched
        self._gate = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        assert self.says() == "ready\n"

    def says(self) -> str:
        """Wait for the next line that the gate prints."""
        assert self._gate.stdout is not None
        return self._gate.stdout.readline()

    def watch(self, pid: int) -> None:
        """Have the gate look at a process from now on."""
        (self._proc / str(pid)).symlink_to(f"/proc/{pid}")
        self._show_newest(pid)

    def _show_newest(self, pid: int) -> None:
        """Name a process as the newest: the gate makes its list again.

        Processes that others on this machine start would have it make its list all the time.
        """
        os.pwrite(self._newest, f"0.00 0.00 0.00 1/1 {pid:9}\n".encode(), 0)

    def end(self) -> tuple[int, int]:
        """End the gate; return how often it leapt, and how often wrongly for all that it knows."""
        self._gate.send_signal(signal.SIGTERM)
        text, _nothing = self._gate.communicate(timeout=DEADLINE_S)
        leaps, wrong = text.split()
        return int(leaps), int(wrong)

    def kill(self) -> None:
        """End the gate, however it is."""
        self._gate.kill()
        self._gate.communicate(timeout=DEADLINE_S)
        os.close(self._newest)


@contextmanager
def stepping(watched: bool = False, held_s: float = HELD_S) -> Iterator[Stepping]:
    """Run a gate that looks at this process, and at others that are named."""
    with TemporaryDirectory(dir="/tmp") as folder:  # sockets need a short path
        gate = Stepping(Path(folder), watched, held_s)
        try:
            gate.watch(os.getpid())
            yield gate
        finally:
            gate.kill()


def stands(time_: SteppedTime) -> bool:
    """Return whether the clock stands for a while of the wall."""
    before_ns = time_.now_ns()
    time.sleep(0.05)
    return time_.now_ns() == before_ns
