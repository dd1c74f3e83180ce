"""The shell of a Mininet node, which Mininet would wait for for ever when it is slow or gone."""

import codecs
import os
import pty
import select
import shutil
import signal
import subprocess
import termios
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Any

from mininet.log import warn

from topologies.system.processes.owners import owner
from topologies.system.processes.programs import SETUP, NetworkError, callers_environment
from topologies.timeouts import COMMAND_TIMEOUT_S, END_TIMEOUT_S, SHELL_POLL_MS, SHELL_TIMEOUT_S

PROMPT = chr(127)  # Mininet's
# First commands of a shell. Its output would end where a program prints the prompt.
QUIETLY = "unset HISTFILE; export -n PS1; set +m\n"
PROMPTS = 2  # of a new shell: this one comes after it
NEEDED = ("mnexec", "ifconfig", "bash")
LOCAL_FLAGS = 3  # of the settings of a terminal


def shell_command(node: str) -> list[str]:
    return ["bash", "--norc", "--noediting", "-is", f"mininet:{node}"]


class ShellWatcher:
    """A node whose waits for its shell end: with the shell, or at a deadline.

    Commands of people may take as long as they like; those that set a network up, while the node
    is `time_limited`, may not. While it is `ending`, a shell that does not answer is killed.
    """

    name: str
    inNamespace: bool  # noqa: N815 (Mininet's name)
    privateDirs: list[Any]  # noqa: N815 (Mininet's name)
    unmountPrivateDirs: Callable[[], None]  # noqa: N815 (Mininet's name)
    time_limited = ending = False

    @classmethod
    def checkSetup(cls) -> None:  # noqa: N802 (Mininet's name)
        """Raise NetworkError for a program that is missing.

        Mininet would run others to find out, which a Ctrl-C reaches, and end this one.
        """
        for program in NEEDED:
            if shutil.which(program) is None:
                raise NetworkError(f"{program} is not installed; {SETUP}")

    @property
    def shell_ended(self) -> bool:
        shell = getattr(self, "shell", None)
        return shell is not None and shell.poll() is not None

    @property
    def shell_stopped(self) -> bool:
        shell = getattr(self, "shell", None)
        process = None if shell is None else owner(shell.pid)
        return process is not None and process.stopped

    def startShell(self, mnopts: str | None = None) -> None:  # noqa: N802 (Mininet's name)
        """Start the shell and wait for its prompt; raise NetworkError if there will be none.

        As Mininet does, but in a session of its own from birth, so that no Ctrl-C reaches it.
        """
        del mnopts  # of remote nodes
        self.master, self.slave = pty.openpty()
        settings = termios.tcgetattr(self.slave)
        settings[LOCAL_FLAGS] &= ~termios.ECHO
        termios.tcsetattr(self.slave, termios.TCSANOW, settings)
        self.shell: subprocess.Popen[bytes] = self._begin_shell()
        self.pid = self.shell.pid
        self.attach(self.shell, self.master)

    def _begin_shell(self) -> "subprocess.Popen[bytes]":
        return self._run_shell(["mnexec", "-cn" if self.inNamespace else "-c"])

    def _run_shell(
        self, where: Sequence[str], descriptors: Sequence[int] = ()
    ) -> "subprocess.Popen[bytes]":
        return subprocess.Popen(
            [*where, *shell_command(self.name)],
            stdin=self.slave,
            stdout=self.slave,
            stderr=self.slave,
            env={**self._environment(), "PS1": PROMPT},
            start_new_session=True,
            pass_fds=descriptors,
        )

    def _environment(self) -> dict[str, str]:
        """Return what people's programs on the node have: what those have who call `qmn`."""
        return {**callers_environment(), **self.environment()}

    def popen(self, *arguments: Any, **options: Any) -> "subprocess.Popen[Any]":
        options.setdefault("env", self._environment())
        started: subprocess.Popen[Any] = super().popen(*arguments, **options)  # type: ignore[misc]
        return started

    def attach(self, shell: Any, terminal: int) -> None:
        """Speak with a shell by its terminal, and wait for its prompt."""
        self.shell, self.master = shell, terminal
        self.stdin = self.stdout = os.fdopen(self.master)
        self.decoder = codecs.getincrementaldecoder("utf-8")("replace")  # Mininet's would raise
        self.pollOut = select.poll()
        self.pollOut.register(self.stdout, select.POLLIN)
        nodes: Any = self
        nodes.outToNode[self.master] = nodes.inToNode[self.master] = self
        self.execed, self.waiting, self.readbuf = False, False, ""
        self.lastCmd = self.lastPid = None
        self.await_shell()

    def await_shell(self, first: str = "") -> None:
        """Wait until a new shell, which has just been begun and does this first, takes commands."""
        os.write(self.master, (first + QUIETLY).encode())
        self._await_prompts()

    def environment(self) -> dict[str, str]:
        return {}

    def _await_prompts(self) -> None:
        deadline, printed = time.monotonic() + SHELL_TIMEOUT_S, ""
        while printed.count(PROMPT) < PROMPTS:
            if self._has_output():
                printed += os.read(self.master, 1024).decode(errors="replace")
                continue
            ended, late = self.shell_ended, time.monotonic() > deadline
            if ended or late:
                self._kill_shell()
                what = "ended at its start" if ended else f"had no prompt in {SHELL_TIMEOUT_S:g} s"
                text = printed.strip() or f"no output, status {self.shell.returncode}"
                raise NetworkError(f"the shell of {self.name} {what}: {text}")

    def _kill_shell(self) -> None:
        if not self.shell_ended:
            os.killpg(self.shell.pid, signal.SIGKILL)
            self.shell.wait(END_TIMEOUT_S)

    def hang_up(self) -> None:
        if getattr(self, "shell", None) is not None and not self.shell_ended:
            for number in (signal.SIGHUP, signal.SIGCONT):
                os.killpg(self.shell.pid, number)

    def terminate(self) -> None:
        """End the shell, by force if it must be, and close its terminal."""
        if getattr(self, "shell", None) is None:
            return
        if self.privateDirs and not self.shell_ended and not self.waiting:
            self.unmountPrivateDirs()
        self.privateDirs = []
        lived = not self.shell_ended
        self.hang_up()
        try:
            self.shell.wait(END_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            self._kill_shell()
        if lived:
            self.kill_group()
        super().terminate()  # type: ignore[misc]

    def kill_group(self) -> None:
        """End what the shell was just forking as it ended, and what did not hear of that."""
        with suppress(ProcessLookupError):
            os.killpg(self.shell.pid, signal.SIGKILL)

    def cmd(self, *arguments: object, **options: object) -> str:
        """Run a command in the node's shell; one that has ended runs no more of them.

        Raise NetworkError for a shell that ends, or does not answer while it is `time_limited`.
        """
        if self.ending and self.waiting:  # for a command that was given up, and never ends
            self._kill_shell()
            self.waiting = False
        if self.shell_ended:
            self._require_shell()
            return ""
        self._deadline = time.monotonic() + COMMAND_TIMEOUT_S
        output: str = super().cmd(*arguments, **options)  # type: ignore[misc]
        return output

    def sendCmd(self, *arguments: object, **options: object) -> None:  # noqa: N802 (Mininet's name)
        """Begin a command in the node's shell; raise NetworkError if that has ended."""
        if self.shell_ended:
            raise NetworkError(self.no_shell)
        super().sendCmd(*arguments, **options)  # type: ignore[misc]

    @property
    def no_shell(self) -> str:
        return f"{self.name} died in mid-run: its shell was ended; start the network again"

    def monitor(self, timeoutms: int | None = None, findPid: bool = True) -> str:  # noqa: N803
        """Return the shell's output; one that ends in mid-command has no more."""
        while timeoutms is None and not self._has_output():
            if self.shell_ended:
                self.waiting = False
                self._require_shell()
                return ""
            if (self.time_limited or self.ending) and time.monotonic() > self._deadline:
                late = f"{self.name} did not end {self.lastCmd!r} in {COMMAND_TIMEOUT_S:g} s"
                if not self.ending:
                    why = ": a signal has stopped its shell" if self.shell_stopped else ""
                    raise NetworkError(f"{late}{why}")
                warn(f"{late}: its shell is killed\n")
                self._kill_shell()
        output: str = super().monitor(timeoutms, findPid)  # type: ignore[misc]
        return output

    def _require_shell(self) -> None:
        if self.time_limited:
            raise NetworkError(f"{self.name} died at its start: its shell was ended")

    def _has_output(self) -> bool:
        """Wait a moment for output; a terminal that was hung up has events, but none."""
        return any(event & select.POLLIN for _file, event in self.pollOut.poll(SHELL_POLL_MS))
