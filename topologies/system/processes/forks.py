"""The fork server of a run, which starts its Python programs in the time that a fork takes."""

import json
import os
import select
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Sequence
from threading import Lock, RLock
from typing import Any

from topologies.system.processes import fork_server
from topologies.system.processes.programs import ENVIRONMENT, ROOT, NetworkError, Program, python
from topologies.timeouts import END_TIMEOUT_S, FORK_TIMEOUT_S, FORK_WAITS, POLL_S
from wire.registered import registered

MODULES = (
    "dispatcher",
    "hosts",
    "hosts.applications.intercept",
    "hosts.applications.service",
    "qswitch_agent",
    # Programs of packages that register them, so that all share one import.
    *sorted(entry.value for entry in registered("qmn.forked").values()),
)
SERVER = "topologies.system.processes.fork_server"
PADDING = " " * 400  # where the commands of its children will be for `ps` to see
ANSWER_BYTES = 64


class Forked:
    """Popen-like handle for a child forked by the fork server."""

    def __init__(self, pid: int) -> None:
        self.pid = pid
        self._status: int | None = None
        self._one_at_a_time = RLock()  # the kernel tells a status once

    def poll(self) -> int | None:
        with self._one_at_a_time:
            if self._status is None:
                ended, status = os.waitpid(self.pid, os.WNOHANG)
                self._status = os.waitstatus_to_exitcode(status) if ended else None
            return self._status

    def wait(self, timeout: float) -> int:
        with self._one_at_a_time:
            if (status := self.poll()) is not None:
                return status
            end, poll = os.pidfd_open(self.pid), select.poll()
        poll.register(end, select.POLLIN)
        try:
            poll.poll(1e3 * timeout)
        finally:
            os.close(end)
        if (status := self.poll()) is None:
            raise subprocess.TimeoutExpired(str(self.pid), timeout)
        return status

    def send_signal(self, number: int) -> None:
        """Send it a signal, unless it has ended: then nobody else can have its id yet."""
        with self._one_at_a_time:
            if self.poll() is None:
                os.kill(self.pid, number)

    def kill(self) -> None:
        self.send_signal(signal.SIGKILL)


class ForkServer:
    """Has the modules loaded that programs of a network are made of, and forks them off.

    It is a program that loads them, but for one that is forked off this process, as that has loaded
    much of it already.
    """

    def __init__(self, program: Program, modules: Sequence[str] = MODULES) -> None:
        self._program = program
        self._modules = modules
        self._one_at_a_time = Lock()
        self._fault: str | None = None  # why it answers no more: nobody waits for it twice
        self._channel, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._channel.settimeout(FORK_TIMEOUT_S)
        command = [python(), "-m", SERVER, str(theirs.fileno()), ",".join(modules), PADDING]
        with theirs:
            this = ThisProcess() if may_fork(modules) else None
            program.start(command, descriptors=[theirs.fileno()], forks=this)

    def close(self) -> None:
        """Let the server end; what it has forked goes on."""
        self._channel.close()

    def serves(self, command: Sequence[str]) -> bool:
        return [*command[:2]] == [python(), "-m"] and command[2] in self._modules

    def start(
        self,
        name: str,
        command: Sequence[str],
        log: int,
        namespace_pid: int | None,
        descriptors: Sequence[int],
    ) -> Forked:
        """Start a command that it serves, as Program.start says; `log` is open for writing.

        Raise NetworkError if the server has ended, or does not answer.
        """
        fork_request = request(name, command, namespace_pid, descriptors)
        return self.fork(fork_request, [log, *descriptors])

    def fork(self, fork_request: dict[str, Any], files: Sequence[int]) -> Forked:
        """Start what `request` describes: with these files, of which the first is its log."""
        name = fork_request["name"]
        with self._one_at_a_time:
            if self._fault:
                raise NetworkError(self._fault)
            try:
                socket.send_fds(self._channel, [json.dumps(fork_request).encode()], files)
                answer = self._answer()
            except TimeoutError as error:
                self._fault = f"{self._program.name} did not start {name} in {FORK_TIMEOUT_S:g} s"
                if self._program.stopped:
                    self._fault += ": a signal has stopped it (SIGSTOP)"
                raise NetworkError(self._fault) from error
            except ConnectionError:
                answer = b""
        if not answer:
            self._await_end()
            raise NetworkError(f"{self._program.name} died in mid-run: {self._program.end()}")
        return Forked(int(answer))

    def _answer(self) -> bytes:
        """Return what the server answers; raise TimeoutError if it does not.

        Before its first answer it loads all programs. Beside others that want the processors, that
        takes many times as long as alone: one that has used a processor is waited for again.
        """
        for _again in range(FORK_WAITS - 1):
            used = self._program.processor_s
            try:
                return self._channel.recv(ANSWER_BYTES)
            except TimeoutError:
                if self._program.stopped or self._program.processor_s == used:
                    raise
        return self._channel.recv(ANSWER_BYTES)

    def _await_end(self) -> None:
        """Wait until the server has ended: its socket closes a moment before."""
        deadline = time.monotonic() + END_TIMEOUT_S
        while self._program.running and time.monotonic() < deadline:
            time.sleep(POLL_S)


class ThisProcess:
    """Forks a fork server off this process: with all that this has loaded."""

    def serves(self, command: Sequence[str]) -> bool:
        return command[2] == SERVER

    def start(
        self,
        name: str,
        command: Sequence[str],
        log: int,
        namespace_pid: int | None,
        descriptors: Sequence[int],
    ) -> Forked:
        fork_request = request(name, command, namespace_pid, descriptors)
        pid = os.fork()
        if not pid:
            fork_server.serve(fork_request, [log, *descriptors])
        return Forked(pid)


def request(
    name: str, command: Sequence[str], namespace_pid: int | None, descriptors: Sequence[int]
) -> dict[str, Any]:
    """Return what a fork server is asked for: by which descriptors its child keeps files."""
    return {
        "name": name,
        "module": command[2],
        "command": list(command),
        "runner": os.getpid(),
        "folder": str(ROOT),
        "namespace_pid": namespace_pid,
        "descriptors": list(descriptors),
    }


def may_fork(modules: Sequence[str]) -> bool:
    """Whether a server can be forked off this process: it has one thread, and has loaded much.

    And it was started in the same environment as programs are, which C libraries read only then. So
    have `qmn` itself and its points of sweeps, and what another has forked off; scripts of
    others are left alone.
    """
    main = getattr(sys.modules["__main__"], "__spec__", None)
    is_qmn = main is not None and main.name.startswith("qmn.")
    imported = all(fork_server.runnable(name) in sys.modules for name in modules)
    alike = os.environ.items() >= ENVIRONMENT.items()
    return (imported or (is_qmn and alike)) and fork_server.threads() == 1
