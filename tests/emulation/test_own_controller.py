"""A controller of one's own: the example in plain Ryu opens light that a session runs over."""

import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from conftest import ROOT
from test_mininet_command import mn

from topologies.runtime import free_port


@contextmanager
def example(log: Path) -> Iterator[int]:
    """Run the example; give its OpenFlow port."""
    port = free_port()
    command = [sys.executable, "examples/standing_light.py", f"--ofp-tcp-listen-port={port}"]
    with log.open("w") as output:
        program = subprocess.Popen(command, cwd=ROOT, stdout=output, stderr=subprocess.STDOUT)
    try:
        yield port
    finally:
        program.send_signal(signal.SIGTERM)
        program.wait(10)


def test_a_session_runs_over_the_light_of_another_controller(tmp_path: Path) -> None:
    got, log = tmp_path / "got", tmp_path / "controller.log"
    commands = [
        f"bob python -m hosts.applications.receive --output {got} 7 > {tmp_path}/log &",
        f"bob until grep -q listening {tmp_path}/log; do true; done",
        f"sh until grep -q 'light stands' {log}; do true; done",
        "alice echo hello | timeout 30 python -m hosts.applications.send bob 7",
    ]
    with example(log) as port:
        output = mn(
            *("--controller", f"remote,ip=127.0.0.1,port={port}"),
            topo="sdc,light=standing,length_km=0.5",
            commands="\n".join([*commands, "exit", ""]),
        )
    assert "refused" not in log.read_text()
    assert '"event": "done"' in output, output
    assert got.read_text() == "hello\n"


def test_hosts_that_want_a_grant_refuse_standing_light(tmp_path: Path) -> None:
    log = tmp_path / "controller.log"
    commands = [
        f"sh until grep -q 'light stands' {log}; do true; done",
        "alice echo hello | timeout 30 python -m hosts.applications.send bob 7",
    ]
    with example(log) as port:
        output = mn(
            *("--controller", f"remote,ip=127.0.0.1,port={port}"),
            commands="\n".join([*commands, "exit", ""]),
        )
    assert "NOT_ARBITRATED" in output, output
