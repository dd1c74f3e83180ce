"""Commands of other packages: each has a deadline, and its output is in the error if it fails."""

import os
import shutil
import signal
import subprocess
import time
from collections.abc import Callable, Iterable, Mapping

from topologies.system.processes.programs import SETUP, NetworkError
from topologies.timeouts import COMMAND_LOOK_S, COMMAND_TIMEOUT_S, INTERFACE_S

WITH_THIS_PROCESS = "setpriv", "--pdeathsig", "KILL"  # ends what follows with who starts it


def ip(commands: Iterable[str]) -> None:
    """Run commands of ip(8) together; raise NetworkError for the first that fails."""
    lines = [f"{command}\n" for command in commands]
    limit_s = COMMAND_TIMEOUT_S + INTERFACE_S * len(lines)
    run("ip", "-batch", "-", text="".join(lines), timeout_s=limit_s)


def run(
    *command: str,
    timeout_s: float,
    text: str = "",
    check: Callable[[], None] = lambda: None,
    look_s: float = COMMAND_LOOK_S,
    environment: Mapping[str, str] | None = None,
) -> str:
    """Run a command and return what it says; raise NetworkError unless it ends well, in time.

    It reads what is given. Meanwhile `check` is called, every `look_s` seconds, which raises if
    something else makes the wait useless. Its own children that it waits for end with it.
    It ends if this process is killed: what it would go on with, the next run has removed by then.
    """
    if shutil.which(command[0]) is None:
        raise NetworkError(f"{command[0]} is not installed; {SETUP}")
    # In a session of its own: a Ctrl-C must not leave half of what it does undone.
    with subprocess.Popen(
        [*WITH_THIS_PROCESS, *command],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=environment,
        start_new_session=True,
    ) as process:
        try:
            deadline = time.monotonic() + timeout_s
            output, wrong = _end_of_command(process, text, deadline, check, look_s)
        except subprocess.TimeoutExpired as error:
            raise NetworkError(f"{command[0]} did not end in {timeout_s:g} s") from error
        finally:
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGKILL)
    if process.returncode:
        words = (wrong or output).strip()
        raise NetworkError(f"{' '.join(command[:3])} failed: {words}")
    return output


def _end_of_command(
    process: "subprocess.Popen[str]",
    text: str,
    deadline: float,
    check: Callable[[], None],
    look_s: float,
) -> tuple[str, str]:
    """Return what a command says, and what it says on standard error, when it has ended."""
    unread: str | None = text
    while True:
        try:
            return process.communicate(unread, timeout=look_s)
        except subprocess.TimeoutExpired:
            unread = None  # it has that now
            check()
            if time.monotonic() > deadline:
                raise
