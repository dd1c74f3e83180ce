"""The topology in Mininet's own program."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from conftest import ROOT
from limits import PROGRAM_S, SOON_S

pytestmark = pytest.mark.usefixtures("machines_open_vswitch")


def mn(*arguments: str, commands: str = "", file: str = "topologies/sdc", topo: str = "sdc") -> str:
    """Run `mn` to its end; return what it printed."""
    done = subprocess.run(
        ["mn", "--custom", f"{file}.py", "--topo", topo, *arguments],
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": "."},
        input=commands,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        check=True,
        timeout=PROGRAM_S,
    )
    return done.stdout


@pytest.mark.image
def test_all_hosts_reach_each_other() -> None:
    assert "0% dropped (12/12 received)" in mn("--test", "pingall")


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("file", "topo", "fibers"),
    [
        ("topologies/chain", "chain,switches=2", 2),
        ("topologies/ring", "ring,switches=3,length_km=0.5,preset=lab", 6),
        ("topologies/leaf_spine", "leaf_spine,leaves=2,spines=2", 4),
    ],
)
def test_it_takes_larger_networks_with_parameters(file: str, topo: str, fibers: int) -> None:
    output = mn(commands="pingall\nlinks\nexit\n", file=file, topo=topo)
    assert "0% dropped (12/12 received)" in output
    assert len(re.findall(r"q\d-eth\d+<->q\d-eth\d+ \(OK OK\)", output)) == fibers


@pytest.mark.nightly
def test_its_command_line_sends_by_superdense_coding(tmp_path: Path) -> None:
    got = tmp_path / "got"
    commands = [
        f"bob python -m hosts.applications.receive --output {got} 7 > {tmp_path}/log &",
        f"bob until grep -q listening {tmp_path}/log; do true; done",
        "alice echo hello | python -m hosts.applications.send bob 7",
        "links",
    ]
    output = mn(commands="\n".join([*commands, "exit", ""]))
    assert '"event": "done"' in output
    assert "alice-q0<->q1-eth2 (OK OK)" in output
    assert got.read_text() == "hello\n"


def test_a_link_is_down_or_up_when_the_controller_has_heard_of_it() -> None:
    last = 'sh grep \'"event": "port"\' /run/qmn/*/controller.jsonl | tail -1'
    output = mn(commands=f"link alice q1 down\n{last}\nlink alice q1 up\n{last}\nexit\n")
    assert re.findall(r'"up": (\w+)}', output) == ["false", "true"]


AT_ONCE = """
import time
from topologies.networks import disk
from topologies.system.processes import shells
from topologies.nodes import ClassicalHost
from topologies.sdc import Mininet, SdcTopo, controllers, findController

shells.COMMAND_TIMEOUT_S, disk.LOG_BYTES, disk.DISK_LOOK_S = 1.0, 10_000, 0.1


class Slow(ClassicalHost):
    def config(self, **params):
        self.cmd("sleep 60")
        return super().config(**params)


class SlowTopo(SdcTopo):
    def build(self):
        super().build()
        self.addHost("dave", cls=Slow, ip="10.0.0.9/24")


topos = {"sdc": SdcTopo, "slow": SlowTopo}
"""


BUILD = """
from own import Mininet, findController, topos
from topologies.system.processes.programs import NetworkError

net = Mininet(topos["slow"](), controller=findController(), build=False)
try:  # by mn itself its own cleaning up would follow
    net.build()
except NetworkError as error:
    print(error)
net.stop()
"""


def test_a_command_that_sets_a_node_up_has_a_deadline(tmp_path: Path) -> None:
    (tmp_path / "own.py").write_text(AT_ONCE)
    (tmp_path / "build.py").write_text(BUILD)
    done = subprocess.run(
        [sys.executable, tmp_path / "build.py"],
        env={**os.environ, "PYTHONPATH": f"{tmp_path}:{ROOT}"},
        capture_output=True,
        text=True,
        check=True,
        timeout=SOON_S,
    )
    assert done.stdout == "dave did not end 'sleep 60' in 1 s\n"


def test_it_ends_though_a_shell_is_stopped(tmp_path: Path) -> None:
    (tmp_path / "own.py").write_text(AT_ONCE)
    commands = "py __import__('os').kill(alice._confined, 19)\nexit\n"
    output = mn(commands=commands, file=str(tmp_path / "own"))
    assert re.search(
        r"alice did not end 'ip link del alice-\w+' in 1 s: its shell is killed", output
    )


def test_its_logs_are_bounded(tmp_path: Path) -> None:
    """A line too long for that is in the log of a program of the run, and then beside it."""
    (tmp_path / "own.py").write_text(AT_ONCE)
    dispatcher = "next(p for p in bob.network.programs if p.name == 'dispatcher')"
    commands = [
        f"py {dispatcher}.log.write_text('x' * 20_000)",
        "sh for i in $(seq 100); do ls /run/qmn/*/dispatcher.log.1 && break; sleep .1; done",
        f"py {dispatcher}.log.stat().st_size < 20_000",
    ]
    output = mn(commands="\n".join([*commands, "exit", ""]), file=str(tmp_path / "own"))
    assert "/dispatcher.log.1\n" in output
    assert "True" in output


@pytest.mark.nightly
def test_its_iperf_ends_and_tells_both_rates() -> None:
    """Mininet's own waits for ever for a report that the iperf of today does not make."""
    output = mn(commands="iperf alice bob\nexit\n")
    assert re.search(r"Results: \['[\d.]+ [GMK]?bits/sec', '[\d.]+ [GMK]?bits/sec'\]", output)


def test_its_command_line_stops_and_starts_a_switch() -> None:
    output = mn(commands="switch s1 stop\nalice ping -c1 -W1 bob\nswitch s1 start\npingall\nexit\n")
    assert "1 packets transmitted, 0 received" in output
    assert "0% dropped (12/12 received)" in output


# The stock app answers 404, or nothing, until it has heard of the switch itself.
FETCH = """
import sys, time, urllib.error, urllib.request
deadline = time.monotonic() + 20
while time.monotonic() < deadline:
    try:
        answer = urllib.request.urlopen(sys.argv[1], timeout=5).read().decode()
    except urllib.error.HTTPError as error:
        answer = f"{sys.argv[1]}: {error}"
    if "tx_grid" in answer:
        break
    time.sleep(0.1)
print(answer)
"""


def test_its_command_line_sets_up_the_controller(tmp_path: Path) -> None:
    address = "127.0.0.1:18089"
    fetch = tmp_path / "fetch.py"
    fetch.write_text(FETCH)
    output = mn(
        *("--controller", f"quantum,rest={address},apps=ryu.app.ofctl_rest"),
        commands=f"sh python3 {fetch} http://{address}/stats/portdesc/4097\nexit\n",
    )
    assert output.count('"tx_grid_freq_lmda": 50000') == 5, output
