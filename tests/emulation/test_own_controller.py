"""A controller of one's own: the example in plain Ryu opens light that a session runs over."""

import ast
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from conftest import ROOT
from documentation import blocks
from test_documentation import bash
from test_mininet_command import mn

from topologies.system.runs.runtime import free_port

pytestmark = pytest.mark.usefixtures("machines_open_vswitch")


@contextmanager
def example(log: Path, *options: str) -> Iterator[None]:
    """Run the example."""
    command = [sys.executable, "examples/standing_light.py", *options]
    with log.open("w") as output:
        program = subprocess.Popen(command, cwd=ROOT, stdout=output, stderr=subprocess.STDOUT)
    try:
        yield
    finally:
        program.send_signal(signal.SIGTERM)
        program.wait(10)


@pytest.mark.nightly
def test_a_session_runs_over_the_light_of_another_controller(tmp_path: Path) -> None:
    got, log = tmp_path / "got", tmp_path / "controller.log"
    commands = [
        f"bob python -m hosts.applications.receive 7 > {got} 2> {tmp_path}/log &",
        f"bob until grep -q listening {tmp_path}/log; do true; done",
        f"sh until grep -q 'light stands' {log}; do true; done",
        "alice echo hello | timeout 30 python -m hosts.applications.send bob 7",
    ]
    port = free_port()
    with example(log, f"--ofp-tcp-listen-port={port}"):
        output = mn(
            *("--controller", f"remote,ip=127.0.0.1,port={port}"),
            topo="sdc,light=standing,length_km=0.5",
            commands="\n".join([*commands, "exit", ""]),
        )
    assert "refused" not in log.read_text()
    assert '"event": "done"' in output, output
    assert got.read_text() == "hello\n"


def test_the_block_of_the_page_and_of_the_example_does_as_it_says(tmp_path: Path) -> None:
    (block,) = [each for each in blocks("docs/openflow.md") if "standing_light" in each]
    assert block == "".join(f"{line[4:]}\n" for line in shown_by_the_example())
    _controller, network, *lines = block.splitlines()
    typed = [line.removeprefix("mininet> ") for line in lines]
    got = tmp_path / "got"
    commands = "\n".join([*(line.replace("/tmp/got", str(got)) for line in typed), "exit", ""])
    with example(tmp_path / "log"):
        output = bash(f"{network.removeprefix('sudo ')} 2>&1", ROOT, typed=commands)
    assert '"event": "done"' in output, output
    assert output.count("hello\n") == 1, output
    assert got.read_text() == "hello\n"


def shown_by_the_example() -> list[str]:
    """Return the lines that the example's docstring says to type."""
    text = ast.get_docstring(ast.parse((ROOT / "examples/standing_light.py").read_text())) or ""
    return [line for line in text.splitlines() if line.startswith("    ")]


def test_hosts_that_want_a_grant_refuse_standing_light(tmp_path: Path) -> None:
    log = tmp_path / "controller.log"
    commands = [
        f"sh until grep -q 'light stands' {log}; do true; done",
        "alice echo hello | timeout 30 python -m hosts.applications.send bob 7",
    ]
    port = free_port()
    with example(log, f"--ofp-tcp-listen-port={port}"):
        output = mn(
            *("--controller", f"remote,ip=127.0.0.1,port={port}"),
            commands="\n".join([*commands, "exit", ""]),
        )
    assert "NOT_ARBITRATED" in output, output
