"""qmn doctor finds what a killed run has left, and qmn clean removes that and nothing else."""

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from conftest import ROOT, interfaces, our_processes, qmn_command, wait_until
from limits import SOON_S

from topologies.networks.network import Network
from topologies.system.kernel.interfaces import delete
from topologies.system.open_vswitch import openvswitch
from topologies.system.runs.runtime import RUNTIME_ROOT

pytestmark = pytest.mark.image

FOREIGN = "foreign0"


def verb(*words: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "qmn", *words]
    return subprocess.run(
        command, cwd=ROOT, capture_output=True, text=True, check=False, timeout=SOON_S
    )


def finding(name: str) -> dict[str, Any]:
    found = {item["name"]: item for item in json.loads(verb("doctor", "--json").stdout)}
    one: dict[str, Any] = found[name]
    return one


@pytest.fixture
def foreign() -> Iterator[None]:
    """Make a bridge and an interface that are not ours."""
    openvswitch.vsctl("add-br", FOREIGN, "--", "set", "bridge", FOREIGN, "datapath_type=netdev")
    subprocess.run(
        ["ip", "link", "add", "s7-eth1", "type", "veth", "peer", "name", "s7-eth2"], check=True
    )
    yield
    assert FOREIGN in openvswitch.bridges()
    assert "s7-eth1" in interfaces()
    openvswitch.delete(FOREIGN)
    delete("s7-eth1")


@pytest.mark.usefixtures("foreign")
def test_what_a_killed_run_leaves_is_found_and_removed(tmp_path: Path) -> None:
    file = tmp_path / "file"
    file.write_bytes(os.urandom(60_000))
    others = our_processes()
    options = ["--file", str(file), "--handshake", "per-pair"]
    with subprocess.Popen([*qmn_command(tmp_path), *options], stdout=subprocess.DEVNULL) as run:
        wait_until(lambda: list(tmp_path.glob("*/c0.pcap")), "captures")
        run.kill()
    wait_until(lambda: our_processes() == others, "the end of its programs")
    (listed,) = json.loads(verb("runs", "--runs", str(tmp_path), "--json").stdout)
    assert (listed["what"], listed["outcome"]) == ("sdc sdc", "not done: its runner was killed")

    left = finding("leftovers of earlier runs")
    assert left["state"] == "limited"
    for thing in ("bridge s1", "bridge q1", f"folder {RUNTIME_ROOT}/{run.pid}-"):
        assert thing in left["found"]
    assert FOREIGN not in left["found"]

    done = verb("clean")
    assert done.returncode == 0, done.stderr
    assert {"removed bridge s1", "removed bridge q1"} <= set(done.stdout.splitlines())
    assert finding("leftovers of earlier runs")["state"] == "works"
    assert verb("clean").stdout == "nothing of ours is left\n"


@pytest.mark.usefixtures("foreign")
def test_open_vswitch_goes_on_while_a_bridge_of_others_is_in_it() -> None:
    starter = openvswitch.starter()
    assert starter
    openvswitch.stop_if_ours(starter)
    assert openvswitch.running()
    assert openvswitch.starter() == starter


def test_a_running_network_is_left_alone(network: Network) -> None:
    before = (openvswitch.bridges(), interfaces())
    done = verb("clean")
    assert done.returncode == 1
    assert "another qmn network is running" in done.stderr
    assert finding("running network")["state"] == "limited"
    assert finding("leftovers of earlier runs")["state"] == "works"
    assert finding("names s1, q1")["state"] == "works"
    assert (openvswitch.bridges(), interfaces()) == before
    network.check()
