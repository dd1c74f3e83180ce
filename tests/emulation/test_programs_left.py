"""A test is held to account for its own programs, wherever they are, and for no others."""

import os
import signal
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager

from conftest import MARK, our_processes, wait_until

VARIABLE, VALUE = MARK


@contextmanager
def slept(*command: str, **environment: str) -> Iterator[set[str]]:
    """Let a shell leave a daemon behind; give what is found of it, and end it."""
    before = our_processes()
    others = {name: value for name, value in os.environ.items() if name != VARIABLE}
    script = '"$@" >/dev/null & echo $!'
    shell = ["bash", "-c", script, "bash", *command]
    done = subprocess.run(
        shell, env={**others, **environment}, stdout=subprocess.PIPE, text=True, check=True
    )
    daemon = int(done.stdout)
    try:
        with open(f"/proc/{daemon}/comm") as name:
            wait_until(lambda: name.seek(0) or name.read() == "sleep\n", "it sleeps")
        yield our_processes() - before
    finally:
        os.kill(daemon, signal.SIGKILL)


def test_a_daemon_in_a_network_namespace_is_found() -> None:
    with slept("unshare", "--net", "setsid", "sleep", "60", **{VARIABLE: VALUE}) as found:
        assert [program.partition(" ")[2] for program in found] == ["sleep 60 "]


def test_programs_of_others_are_not_found() -> None:
    with slept("sleep", "60") as found:
        assert found == set()
    with slept("sleep", "60", **{VARIABLE: "another"}) as found:
        assert found == set()
