"""The programs of a run: each started, watched and ended by its own handle."""

import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
STOP_TIMEOUT_S = 5.0
POLL_S = 0.02
ENVIRONMENT = {
    "PYTHONPATH": str(ROOT),
    "PYTHONUNBUFFERED": "1",
    # gRPC's older I/O engine: a small message takes it half the processor time.
    "GRPC_EXPERIMENTS": "-event_engine_client,-event_engine_listener",
    "GRPC_VERBOSITY": "ERROR",  # the last line of a log is to say what ended the program
}


class NetworkError(Exception):
    """The network cannot start or go on; the text names cause and remedy."""


def python() -> str:
    """Return the interpreter that has our packages; Mininet's own `mn` runs on another."""
    inside = sys.prefix != sys.base_prefix
    return sys.executable if inside else str(ROOT / ".venv" / "bin" / "python")


class Program:
    """One child process; what it prints goes into a log file."""

    def __init__(self, name: str, log: Path) -> None:
        self.name = name
        self.log = log
        self._process: subprocess.Popen[bytes] | None = None

    def start(
        self,
        command: Sequence[str],
        namespace_pid: int | None = None,
        descriptors: Sequence[int] = (),
    ) -> None:
        """Start the command, in the network namespace of a process if one is given.

        The child gets a session of its own, so that Ctrl-C reaches only the runner, and a
        signal when the runner dies, so that nothing is left behind. It keeps the open files
        with these descriptors.
        """
        inside = ["mnexec", "-a", str(namespace_pid)] if namespace_pid else []
        environment = {**os.environ, **ENVIRONMENT}
        with self.log.open("ab") as log:
            self._process = subprocess.Popen(
                [*inside, "setpriv", "--pdeathsig", "TERM", *command],
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                cwd=ROOT,
                env=environment,
                start_new_session=True,
                pass_fds=descriptors,
            )

    @property
    def status(self) -> int | None:
        """The exit status, None while it runs."""
        return self._process.poll() if self._process else None

    @property
    def running(self) -> bool:
        """Whether it was started and has not ended."""
        return self._process is not None and self._process.poll() is None

    def wait_for(self, text: str, timeout_s: float) -> None:
        """Wait until a line of the log contains text; raise NetworkError if it will not."""
        deadline, words = time.monotonic() + timeout_s, re.compile(rf"\b{re.escape(text)}\b")
        while not words.search(self.log.read_text(errors="replace")):
            if not self.running:
                raise NetworkError(f"{self.name} ended at its start: {self.end()}")
            if time.monotonic() > deadline:
                raise NetworkError(
                    f"{self.name} was not ready in {timeout_s:g} s; its log: {self.log}"
                )
            time.sleep(POLL_S)

    def last_words(self) -> str:
        """Return the last line of the log."""
        lines = self.log.read_text(errors="replace").strip().splitlines()
        return lines[-1] if lines else ""

    def end(self) -> str:
        """Return how it ended, for an error message."""
        status = self.status or 0
        if status < 0:
            return f"killed by {signal.Signals(-status).name}"
        return self.last_words() or f"status {status}, it said nothing"

    def ask_to_stop(self) -> None:
        """Send the signal that ends it politely."""
        if self._process is not None and self._process.poll() is None:
            self._process.send_signal(signal.SIGTERM)

    def kill(self) -> None:
        """End it at once, as a crash would."""
        if self._process is not None:
            self._process.kill()
            self._process.wait(STOP_TIMEOUT_S)

    def stop(self) -> None:
        """End it: politely, then by force after STOP_TIMEOUT_S."""
        if self._process is None:
            return
        self.ask_to_stop()
        try:
            self._process.wait(STOP_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            self.kill()


def stop_all(programs: Sequence[Program]) -> None:
    """End programs together, before what they stand on is taken away."""
    for program in programs:
        program.ask_to_stop()
    for program in programs:
        program.stop()
