"""The programs of a run: each started, watched and ended by its own handle."""

import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Protocol

from programs.faults import reported_fault
from topologies.system.processes.owners import owner
from topologies.timeouts import POLL_S, STOP_TIMEOUT_S, STOP_WAITS

ROOT = Path(__file__).resolve().parents[3]
SETUP = "run " + ("`make setup`" if (ROOT / "Makefile").exists() else "`qmn doctor --install`")
ENVIRONMENT = {
    "PYTHONPATH": str(ROOT),
    **dict(
        line.split("=", 1)
        for line in (ROOT / "topologies" / "environment").read_text().splitlines()
        if not line.startswith("#")
    ),
}
# Where the tools of root are, which `su` leaves out of PATH.
TOOLS = ("/usr/local/sbin", "/usr/sbin", "/sbin")
CALLER = "QMN_CALLER"  # in the environment that bin/qmn has made of its caller's
# The kernel ends it with the runner; if that has ended before it asked for this, it ends itself.
UNLESS_ORPHANED = '[ "$PPID" = "$0" ] && exec "$@"'
WITH_RUNNER = ("setpriv", "--pdeathsig", "TERM", "sh", "-c", UNLESS_ORPHANED)
NOT_SEEN = "0"  # process id of a parent in another namespace of processes: pid_namespaces(7)
TRACEBACK = "Traceback (most recent call last)"
FRAME = re.compile(r"^[ |]*[|+][-+ |]*(\d+ -+)?(?=\S|$)")  # around errors of a group
ERROR = re.compile(r"[A-Za-z_][\w.]*(:|$)")


def find_tools() -> None:
    folders = (os.environ.get("PATH") or os.defpath).split(os.pathsep)
    missing = [folder for folder in TOOLS if folder not in folders]
    os.environ["PATH"] = os.pathsep.join([*folders, *missing])


def callers_environment() -> dict[str, str]:
    """Return the environment of who called `qmn`: for what people start, which is not ours.

    bin/qmn sets that of our programs, and keeps what its caller has set of it.
    """
    if CALLER not in os.environ:
        return dict(os.environ)
    prefix = f"{CALLER}_"
    ours = {name for name in os.environ if name == CALLER or name.startswith(prefix)}
    others = {name: os.environ[name] for name in os.environ.keys() - ENVIRONMENT.keys() - ours}
    return {**others, **{name.removeprefix(prefix): os.environ[name] for name in ours - {CALLER}}}


class NetworkError(Exception):
    """The network cannot start or go on; the text names cause and remedy."""


class Process(Protocol):
    """A process as a program needs it: the part of subprocess.Popen that is used."""

    pid: int

    def poll(self) -> int | None:
        """Return the exit status, None while it runs."""

    def wait(self, timeout: float) -> int:
        """Return the exit status; raise subprocess.TimeoutExpired if it has not ended by then."""

    def send_signal(self, number: int, /) -> None:
        """Send it a signal if it runs."""

    def kill(self) -> None:
        """End it at once."""


class Forks(Protocol):
    """A faster way to start some commands (topologies/system/processes/forks.py)."""

    def serves(self, command: Sequence[str]) -> bool:
        """Whether it starts this one."""

    def start(
        self,
        name: str,
        command: Sequence[str],
        log: int,
        namespace_pid: int | None,
        descriptors: Sequence[int],
    ) -> Process:
        """Start it as a child of this process, with its environment, and all as Program.start."""


class Elsewhere(Protocol):
    """Another machine, which starts programs (topologies/system/machines/machine.py)."""

    def start(
        self, command: Sequence[str], write: Callable[[bytes], None], pid: int, python: bool
    ) -> Process:
        """Start a command in the namespace of a process there; `write` takes what it says."""


def python() -> str:
    """Return the interpreter that has our packages; Mininet's own `mn` runs on another."""
    interpreter = ROOT / ".venv" / "bin" / "python"  # not there in an installed package
    inside = sys.prefix != sys.base_prefix
    return sys.executable if inside or not interpreter.exists() else str(interpreter)


class Program:
    """One child process; what it prints goes into a log file."""

    def __init__(self, name: str, log: Path) -> None:
        self.name = name
        self.log = log
        self._process: Process | None = None
        self._told_to_end = False
        self._elsewhere = False  # on another machine
        self._begins = 0  # where in the log this start of it does

    def start(
        self,
        command: Sequence[str],
        namespace_pid: int | None = None,
        descriptors: Sequence[int] = (),
        forks: Forks | None = None,
    ) -> None:
        """Start the command, in the network namespace of a process if one is given.

        `forks` starts it, if it serves this command.

        The child gets a session of its own, so that Ctrl-C reaches only the runner, and a
        signal when the runner dies, so that nothing is left behind. It keeps the open files
        with these descriptors.
        """
        self._told_to_end = False
        self._begins = self.log.stat().st_size if self.log.exists() else 0
        with self.log.open("ab") as log:
            if forks is not None and forks.serves(command):
                self._process = forks.start(
                    self.name, command, log.fileno(), namespace_pid, descriptors
                )
                return
        inside = ["mnexec", "-a", str(namespace_pid)] if namespace_pid else []
        self._begin([*inside, *WITH_RUNNER, str(os.getpid()), *command], descriptors)

    def start_inside(self, enter: Sequence[str], command: Sequence[str]) -> None:
        """Start the command where `enter` brings it, among processes that the runner is not of.

        The thread that asks has its children born there already.
        """
        self._told_to_end = False
        self._begins = self.log.stat().st_size if self.log.exists() else 0
        self._begin([*WITH_RUNNER, NOT_SEEN, *enter, *command])

    def _begin(self, command: Sequence[str], descriptors: Sequence[int] = ()) -> None:
        with self.log.open("ab") as log:
            self._process = subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                cwd=ROOT,
                env={**os.environ, **ENVIRONMENT},
                start_new_session=True,
                pass_fds=descriptors,
            )

    def start_elsewhere(
        self, machine: Elsewhere, command: Sequence[str], pid: int, python: bool = True
    ) -> None:
        """Start the command, or one of our modules, on another machine; its log is here."""
        self._elsewhere = True
        self._begins = self.log.stat().st_size if self.log.exists() else 0
        self.log.touch()

        def write(output: bytes) -> None:
            with self.log.open("ab") as log:
                log.write(output)

        self._process = machine.start(command, write, pid, python)

    @property
    def pid(self) -> int:
        """The process id; raise NetworkError for a program that was not started."""
        if self._process is None:
            raise NetworkError(f"{self.name} was not started")
        return self._process.pid

    @property
    def status(self) -> int | None:
        return self._process.poll() if self._process else None

    @property
    def running(self) -> bool:
        return self._process is not None and self._process.poll() is None

    def wait_for(
        self, text: str, timeout_s: float, check: Callable[[], None] = lambda: None
    ) -> None:
        """Wait until a line of the log contains text; raise NetworkError if it will not.

        Time in which the program waited for a processor does not count. Meanwhile `check` is
        called, which raises if something else makes the wait useless.
        """
        deadline = time.monotonic() + timeout_s - self._queued_s()
        pattern = re.compile(rf"\b{re.escape(text)}\b")
        while not pattern.search(self.output()):
            if not self.running:
                raise NetworkError(f"{self.name} ended at its start: {self.end()}")
            if time.monotonic() > deadline + self._queued_s():
                raise NetworkError(
                    f"{self.name} was not ready in {timeout_s:g} s; its log: {self.log}"
                )
            check()
            time.sleep(POLL_S)

    def _queued_s(self) -> float:
        """Return how long its first thread was ready to run and had no processor (schedstat(5))."""
        if self._elsewhere or self._process is None:
            return 0.0
        try:
            return int(Path(f"/proc/{self.pid}/schedstat").read_text().split()[1]) / 1e9
        except (FileNotFoundError, ProcessLookupError):
            return 0.0  # it has ended, or this kernel does not count

    def cut_log(self, most_bytes: int) -> None:
        """Begin a new log if it is longer; the earlier one is beside it, in <log>.1.

        A program that writes just then may lose a line.
        """
        if not self.log.exists() or self.log.stat().st_size <= most_bytes:
            return
        shutil.copyfile(self.log, self.log.with_name(f"{self.log.name}.1"))
        os.truncate(self.log, 0)  # the program goes on at its end, wherever that is
        self._begins = 0

    def output(self) -> str:
        with self.log.open("rb") as log:
            log.seek(self._begins)
            return log.read().decode(errors="replace")

    def last_words(self) -> str:
        lines = self.output().strip().splitlines()
        return lines[-1] if lines else ""

    def end(self) -> str:
        status = self.status or 0
        if status < 0:
            return f"killed by {signal.Signals(-status).name}"
        if status == 0:
            return f"it ended by itself or by SIGTERM; its log: {self.log}"
        return cause(self.output()) or f"status {status}; its log: {self.log}"

    def crash(self) -> str:
        """Return the error that it did not handle, "" if it has not ended by one."""
        output = self.output() if self.status else ""
        return cause(output) if TRACEBACK in output else ""

    @property
    def stopped(self) -> bool:
        process = None if self._process is None else owner(self._process.pid)
        return process is not None and process.stopped

    @property
    def processor_s(self) -> float:
        process = None if self._process is None else owner(self._process.pid)
        return 0.0 if process is None else process.processor_s

    @property
    def struck_down(self) -> bool:
        """Whether a signal has ended it that did not come from here."""
        return not self._told_to_end and (self.status or 0) < 0

    def ask_to_stop(self) -> None:
        self._told_to_end = True
        if self._process is not None and self._process.poll() is None:
            self._process.send_signal(signal.SIGTERM)
            self._process.send_signal(signal.SIGCONT)

    def kill(self, timeout_s: float = STOP_TIMEOUT_S) -> None:
        """End it at once, as a crash would; raise NetworkError if it does not end in time."""
        self._told_to_end = True
        if self._process is None:
            return
        self._process.kill()
        try:
            self._process.wait(timeout_s)
        except subprocess.TimeoutExpired as error:
            raise NetworkError(
                f"{self.name} (process {self._process.pid}) did not end in {timeout_s:g} s "
                "although it was killed"
            ) from error

    def stop(self) -> None:
        """End it: politely, then by force when it has done nothing for STOP_TIMEOUT_S."""
        if self._process is None:
            return
        self.ask_to_stop()
        for _wait in range(STOP_WAITS):
            used_s = self.processor_s
            try:
                self._process.wait(STOP_TIMEOUT_S)
            except subprocess.TimeoutExpired:
                if self.processor_s == used_s:
                    break
            else:
                return
        self.kill()


def cause(output: str) -> str:
    """Return why a program failed, from its output: its error or the fault it reports, or "".

    Of a Python traceback, also of one of many errors at once, that is the line of the error.
    """
    lines = [FRAME.sub("", line) for line in output.splitlines()]
    tracebacks = [number for number, line in enumerate(lines) if TRACEBACK in line]
    if not tracebacks:
        return reported_fault(output)
    errors = [line for line in lines[tracebacks[-1] :] if ERROR.match(line)]
    return errors[-1] if errors else ""


def stop_all(programs: Sequence[Program]) -> None:
    """End programs together, before what they stand on is taken away."""
    for program in programs:
        program.ask_to_stop()
    for program in programs:
        program.stop()
