"""The controller as a program: what it puts into real bridges, and when it takes it out."""

import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from controller_scene import (
    CLASSICAL,
    DEADLINE_S,
    QUANTUM,
    SESSION,
    Controller,
    Wire,
    between,
    connect,
    flows,
    run,
    running,
    set_up,
    two_bridges,
)
from limits import SOON_S, wait_until
from scapy.layers.inet import TCP

from wire.metadata.setup import SETUP_LENGTH
from wire.metadata.vocabulary import Verdict

pytestmark = pytest.mark.skipif(
    os.geteuid() != 0 or shutil.which("ovs-vsctl") is None,
    reason="needs root and Open vSwitch",
)


@pytest.fixture
def bridges() -> Iterator[dict[str, Wire]]:
    with two_bridges() as wires:
        yield wires


@pytest.fixture(params=["ryu", pytest.param("os-ken", marks=pytest.mark.nightly)])
def controller(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Controller]:
    with running(request.param, tmp_path) as program:
        yield program


def test_a_set_up_opens_light_paths_and_a_fin_closes_them(
    controller: Controller, bridges: dict[str, Wire]
) -> None:
    connect(controller)
    answer = set_up(controller, bridges)
    assert (answer.verdict, answer.rotation) == (Verdict.GRANTED, 0)
    entries = flows(QUANTUM)
    assert entries.count(f"cookie={SESSION:#x}") == 3
    for in_port, out_port in ((6, 3), (3, 5), (7, 4)):
        assert f"priority=100,in_port={in_port} actions=output:{out_port}\n" in entries

    later = 100 + SETUP_LENGTH
    bridges["alice"].send(between("alice", "bob", "PA", later, b"QM later"))
    bridges["bob"].receive(lambda packet: b"QM later" in bytes(packet))
    wait_until(lambda: "priority=300" in flows(CLASSICAL), "bypass")
    bridges["alice"].send(between("alice", "bob", "FA", later + 8))
    bridges["bob"].receive(lambda packet: TCP in packet and "F" in packet[TCP].flags)
    wait_until(lambda: "in_port" not in flows(QUANTUM), "dark")
    wait_until(lambda: "priority=300" not in flows(CLASSICAL), "no bypass")
    assert [line["session"] for line in controller.record("path_ready")] == [f"{SESSION:016x}"]
    assert len(controller.record("torn_down")) == 1
    assert controller.end() == 0
    assert len(controller.record("stopped")) == 1


@pytest.mark.waits
def test_a_session_ends_with_its_switch(controller: Controller, bridges: dict[str, Wire]) -> None:
    connect(controller)
    assert set_up(controller, bridges).verdict == Verdict.GRANTED
    run("ovs-vsctl", "del-controller", QUANTUM)
    wait_until(lambda: controller.record("torn_down"), "session over")
    assert controller.record("torn_down")[0]["detail"] == "switch gone"


def test_paths_of_a_past_life_are_deleted(
    controller: Controller, bridges: dict[str, Wire], tmp_path: Path
) -> None:
    connect(controller)
    assert set_up(controller, bridges).verdict == Verdict.GRANTED
    controller.process.kill()
    controller.process.wait(DEADLINE_S)
    assert flows(QUANTUM).count(f"cookie={SESSION:#x}") == 3
    with running(controller.framework, tmp_path, controller.port):
        wait_until(lambda: "in_port" not in flows(QUANTUM), "dark")


def test_a_taken_port_is_one_clear_line(controller: Controller, tmp_path: Path) -> None:
    second = subprocess.run(
        [sys.executable, "-m", "controller_apps", "--config", str(tmp_path / "config.json")],
        capture_output=True,
        text=True,
        timeout=SOON_S,
        check=False,
    )
    assert second.returncode == 1
    assert second.stdout == ""
    (line,) = second.stderr.splitlines()
    assert f"cannot listen on 127.0.0.1:{controller.port}: Address already in use" in line
