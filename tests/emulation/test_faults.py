"""Bad input and faults: a clear error, a status that is not 0, and nothing left behind."""

import json
import os
import re
import signal
import socket
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from conftest import ROOT, in_runs, our_processes, qmn, qmn_command, qmn_words, verb, wait_until
from limits import SOON_S
from loaded import Running, running_qmn
from scapy.utils import RawPcapReader

from qmn.timeouts import START_TIMEOUT_S
from wire.pcapng import Reader

# Alice's shell is killed when her stack is to be started.
STRUCK = """
import os, signal
from typing import Any
from topologies.nodes import quantum_host
from topologies.sdc import SdcTopo

launch = quantum_host.launch

def struck(network: Any, name: str, module: str, config: Any, host: Any) -> Any:
    if name == "alice":
        os.kill(host.shell.pid, signal.SIGKILL)
        host.shell.wait()
    return launch(network, name, module, config, host)

quantum_host.launch = struck

class Struck(SdcTopo):
    pass
"""

# Bob's application is stopped before it listens, and charlie's stack killed.
STOPPED = """
import os, signal
from pathlib import Path
from typing import Any
from topologies.networks.network import Network
from topologies.sdc import SdcTopo

run_on = Network.run_on

def stopped(network: Network, host: str, role: str, *words: Any) -> Any:
    program = run_on(network, host, role, *words)
    if role == "asked":
        os.kill(program.pid, signal.SIGSTOP)
        next(each for each in network.runtime.programs if each.name == "charlie").kill()
        Path(__file__).with_name("struck").touch()
    return program

Network.run_on = stopped

class Stopped(SdcTopo):
    pass
"""


# Of light: 40 MiB are 168 million pairs, which take 84 s at least.
SLOW = ("--rate-hz", "2000000")


@contextmanager
def long_run(tmp_path: Path) -> Iterator[Running]:
    """Start a run that lasts much longer than the test."""
    file = tmp_path / "long"
    file.write_bytes(bytes(40 << 20))
    with running_qmn(*qmn_words(tmp_path), "--file", str(file), *SLOW) as process:
        yield process


@contextmanager
def run_to_kill(tmp_path: Path) -> Iterator[subprocess.Popen[str]]:
    """Start such a run as a user does: all of it is marked, for who comes after it."""
    file = tmp_path / "long"
    file.write_bytes(bytes(40 << 20))
    words = [*qmn_command(tmp_path), "--file", str(file), *SLOW]
    output = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT}
    with subprocess.Popen(words, cwd=ROOT, text=True, **output) as process:  # type: ignore[call-overload]
        yield process


def read_until(process: Running | subprocess.Popen[str], text: str) -> None:
    """Read what the run prints until a line has the text."""
    assert process.stdout is not None
    for line in process.stdout:
        if text in line:
            return
    raise AssertionError(f"the run ended without printing {text!r}")


def child(process: Running, module: str) -> int:
    """Return the process id of a program of the run, however far below its keeper."""
    parents, commands = {0: 0}, {}
    for folder in Path("/proc").iterdir():
        if not folder.name.isdigit():
            continue
        try:
            commands[int(folder.name)] = (folder / "cmdline").read_bytes().split(b"\0")
            parent = re.search(r"PPid:\t(\d+)", (folder / "status").read_text())
        except OSError:
            continue
        parents[int(folder.name)] = int(parent[1]) if parent else 0
    for pid, command in commands.items():
        above = parents.get(pid, 0)
        while above not in (0, process.pid):
            above = parents.get(above, 0)
        if above and module.encode() in command:
            return pid
    raise AssertionError(f"no process of the run runs {module}")


@pytest.mark.image
@pytest.mark.nightly  # by day: tests/unit/topologies/test_network_watch.py
@pytest.mark.parametrize(
    ("module", "name"),
    [("controller_apps", "c0"), ("qswitch_agent", "q1-agent"), ("dispatcher", "dispatcher")],
)
def test_a_program_that_dies_in_mid_run_is_named(tmp_path: Path, module: str, name: str) -> None:
    with long_run(tmp_path) as process:
        read_until(process, "sending")
        os.kill(child(process, module), signal.SIGKILL)
        output = process.finish(20)
    assert process.returncode == 1
    assert f"qmn: {name} died in mid-run: killed by SIGKILL" in output
    result = json.loads((tmp_path / "latest" / "result.json").read_text())
    assert result["delivered"] is False


@pytest.mark.waits
@pytest.mark.by_day(every=4)  # killed by day are those of a tunnel: test_run_vpn.py
@pytest.mark.parametrize("role", ["asked", "asking"])
@pytest.mark.parametrize("number", [signal.SIGSTOP, signal.SIGKILL])
def test_an_application_that_a_signal_strikes_in_mid_run_is_named(
    tmp_path: Path, role: str, number: signal.Signals
) -> None:
    words = "--options" if role == "asking" else "--output"

    def found() -> list[int]:
        applications = [each for each in our_processes() if "hosts.applications.service" in each]
        return [int(each.split()[0]) for each in applications if words in each]

    with long_run(tmp_path) as process:
        read_until(process, "sending")
        wait_until(found, f"{role} runs")
        os.kill(found()[0], number)
        output = process.finish(40)
    assert process.returncode == 1
    named = {
        signal.SIGKILL: f"qmn: {role} died in mid-run: killed by SIGKILL",
        signal.SIGSTOP: f"qmn: {role} does not answer: a signal has stopped it (SIGSTOP)",
    }
    assert named[number] in output


@pytest.mark.by_day(every=2)
@pytest.mark.parametrize("name", ["alice", "s1"])
def test_a_node_whose_shell_is_killed_is_named(tmp_path: Path, name: str) -> None:
    with long_run(tmp_path) as process:
        read_until(process, "sending")
        os.kill(child(process, f"mininet:{name}"), signal.SIGKILL)
        output = process.finish(20)
    assert process.returncode == 1
    assert f"qmn: {name} died in mid-run: its shell was ended" in output


def test_a_node_whose_shell_is_killed_at_its_start_is_named_in_one_line(tmp_path: Path) -> None:
    topology = tmp_path / "struck.py"
    topology.write_text(STRUCK)
    done = qmn("--topology", f"{topology}:Struck", "--message", "x", runs=tmp_path / "runs")
    assert done.returncode == 1
    (line,) = [each for each in done.stderr.splitlines() if each.startswith("qmn: ")]
    words = r"qmn: alice (died in mid-run|ended at its start): process \d+, the shell of its node, "
    assert re.fullmatch(f"{words}was ended", line), done.stderr
    assert "Traceback" not in done.stderr


def test_a_failure_tells_how_far_it_came(tmp_path: Path) -> None:
    noise = ("--depolarizing", "0.1", "--frame-bytes", "4096")
    done = qmn(*noise, "--message", "x" * 4096, runs=tmp_path, report=True)
    assert done.returncode == 1
    assert "too noisy for frames of 4096 bytes; choose fewer (--frame-bytes; no" in done.stderr
    result = json.loads((tmp_path / "latest" / "result.json").read_text())
    assert result["delivered"] is False
    report = result["job"]["asking"]
    assert report["repeated_frames"] == 64
    assert report["bell_pairs"] == 64 * 4 * 4096
    page = (tmp_path / "latest").resolve() / "report.html"
    assert done.stderr.splitlines()[1:] == [f"report to look at: {page}"]
    assert "too noisy for frames" in page.read_text()


@pytest.mark.image
@pytest.mark.by_day(every=2)
@pytest.mark.parametrize("moment", ["starting the network", "sending"])
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_the_run_cleanly(tmp_path: Path, moment: str, number: signal.Signals) -> None:
    with long_run(tmp_path) as process:
        read_until(process, moment)
        process.send_signal(number)
        output = process.finish(20)
    assert process.returncode == 128 + number
    assert f"interrupted by {number.name}" in output


@pytest.mark.image
def test_the_run_after_a_killed_one_works(tmp_path: Path) -> None:
    with run_to_kill(tmp_path) as process:
        read_until(process, "sending")
        process.kill()
    killed = (tmp_path / "latest").resolve()
    assert qmn("--message", "after", runs=tmp_path).returncode == 0
    captures_stay_by_the_wall(killed)


def captures_stay_by_the_wall(killed: Path) -> None:
    """Look at a killed run: what is made of it later has the network's time, 1,000 s ahead."""
    captured = {file: file.read_bytes() for file in killed.glob("*.pcap")}
    page = Path(verb("report", str(killed)).stdout.strip()).read_text()
    assert "The handshake, in both layers" in page
    verb("wireshark", str(killed))
    assert {file: file.read_bytes() for file in killed.glob("*.pcap")} == captured
    with RawPcapReader(str(killed / "s1-eth1.pcap")) as reader:
        by_wall_s = [about.sec for _data, about in reader]
    with (killed / "all.pcapng").open("rb") as opened:
        in_steps_s = [packet.time_ns / 1e9 for packet in Reader(opened).packets()]
    assert by_wall_s[-1] <= (killed / "s1-eth1.pcap").stat().st_mtime < in_steps_s[-1] - 900


def test_an_ordinary_user_is_told_to_use_sudo(tmp_path: Path) -> None:
    nobody = ["setpriv", "--reuid=65534", "--regid=65534", "--clear-groups"]
    done = subprocess.run(
        [*nobody, *qmn_command(tmp_path)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
        timeout=SOON_S,
    )
    assert done.returncode == 1
    assert "needs root" in done.stderr


def test_a_port_taken_on_this_machine_is_free_in_the_controllers_namespace(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        done = qmn("--openflow-port", str(taken.getsockname()[1]), runs=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    assert "delivered exactly" in done.stdout


def test_what_ends_a_run_is_told_before_clean_up(tmp_path: Path) -> None:
    with long_run(tmp_path) as process:
        read_until(process, "sending")
        os.kill(child(process, "dispatcher"), signal.SIGKILL)
        read_until(process, "ending: dispatcher died in mid-run: killed by SIGKILL")
        assert in_runs("*/dispatcher.json")  # clean-up removes it last
        process.finish(20)
    assert process.returncode == 1


def test_a_host_that_dies_while_another_s_application_starts_is_named_at_once(
    tmp_path: Path,
) -> None:
    topology = tmp_path / "stopped.py"
    topology.write_text(STOPPED)
    runs = tmp_path / "runs"
    done = qmn("--topology", f"{topology}:Stopped", runs=runs)
    named_s = (runs / "latest" / "result.json").stat().st_mtime
    assert done.returncode == 1
    assert "charlie died in mid-run: killed by SIGKILL" in done.stdout
    assert named_s - (tmp_path / "struck").stat().st_mtime < START_TIMEOUT_S / 2
