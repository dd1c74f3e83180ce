"""Open vSwitch's daemons end or stop in the middle of a run: it is said, and nothing stays."""

import os
import shutil
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from conftest import ROOT, interfaces, our_processes, qmn, verb, wait_until
from fabric_scene import running
from limits import SOON_S
from mininet.node import Controller
from test_faults import long_run, read_until, run_to_kill

from topologies.nodes import OpticalSwitch
from topologies.sdc import SdcTopo
from topologies.system.open_vswitch import openvswitch
from topologies.system.processes.owners import from_words
from topologies.system.processes.programs import NetworkError, Program
from topologies.system.runs.runtime import RUNTIME_ROOT
from topologies.timeouts import OPENVSWITCH_TIMEOUT_S, VSCTL_TIMEOUT_S

SAID_IN_S = 20  # with clean-up; the wait ends much sooner


@pytest.fixture
def no_open_vswitch(_open_vswitch: None) -> Iterator[None]:
    """Let none run, so that the run starts its own; afterwards that of the tests runs again."""
    openvswitch.stop_if_ours("tests")
    assert openvswitch.daemons() == {}
    yield
    assert openvswitch.daemons() == {}, "the run has left its own running"
    openvswitch.start("tests")


def struck(tmp_path: Path, daemon: str, number: signal.Signals) -> str:
    """Strike a daemon in mid-run; return what the run says."""
    with long_run(tmp_path) as process:
        read_until(process, "sending")
        openvswitch.daemons()[daemon].signal(number)
        output = process.finish(SAID_IN_S)
    assert process.returncode == 1
    return output


@pytest.mark.usefixtures("no_open_vswitch")
@pytest.mark.parametrize("daemon", openvswitch.DAEMONS)
@pytest.mark.parametrize(
    ("number", "words"),
    [(signal.SIGTERM, "was killed (Terminated)"), (signal.SIGSEGV, "was killed (Segmentation")],
)
def test_a_daemon_that_ends_is_named_and_nothing_of_it_stays(
    tmp_path: Path, daemon: str, number: signal.Signals, words: str
) -> None:
    output = struck(tmp_path, daemon, number)
    assert f"qmn: {daemon} died in mid-run: Open vSwitch's daemon {words}" in output
    assert not interfaces() & {"s1", "q1"}


@pytest.mark.usefixtures("no_open_vswitch")
def test_a_switch_daemon_that_ends_as_an_agent_starts_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The agent ends first: the daemon's sockets close a moment before it has ended itself."""
    launch, daemon = OpticalSwitch.launch, openvswitch.SWITCH_DAEMON

    def end_after(agent: Program) -> None:
        wait_until(lambda: not agent.running, "the agent has ended")
        openvswitch.daemons()[daemon].signal(signal.SIGKILL)

    def struck(switch: OpticalSwitch, controllers: list[Controller]) -> None:
        if switch.program is None:
            (listens_no_more := openvswitch.management(switch.name)).unlink()
            with socket.socket(socket.AF_UNIX) as closed:
                closed.bind(str(listens_no_more))
            launch(switch, controllers)
            threading.Thread(target=end_after, args=(switch.program,)).start()

    monkeypatch.setattr(OpticalSwitch, "launch", struck)
    with (
        pytest.raises(NetworkError, match=r"^ovs-vswitchd died in mid-run: .*killed"),
        running(SdcTopo, tmp_path),
    ):
        pytest.fail("it has started")


@pytest.mark.waits
@pytest.mark.usefixtures("no_open_vswitch")
@pytest.mark.parametrize("daemon", openvswitch.DAEMONS)
def test_a_daemon_that_a_signal_has_stopped_is_named(tmp_path: Path, daemon: str) -> None:
    with long_run(tmp_path) as process:
        read_until(process, "sending")
        openvswitch.daemons()[daemon].signal(signal.SIGSTOP)
        output = process.finish(40)
    assert process.returncode == 1
    assert f"qmn: {daemon} does not answer: a signal has stopped it (SIGSTOP)" in output


@pytest.mark.parametrize("daemon", openvswitch.DAEMONS)
def test_nobody_waits_long_for_a_daemon_that_a_signal_has_stopped(daemon: str) -> None:
    words = rf"^{daemon} does not answer: a signal has stopped it"
    stopped, began = openvswitch.daemons()[daemon], time.monotonic()
    stopped.signal(signal.SIGSTOP)
    try:
        if daemon == openvswitch.DATABASE:
            with pytest.raises(NetworkError, match=words):
                openvswitch.bridges()
        with pytest.raises(NetworkError, match=words):
            openvswitch.vsctl("add-br", "s7")
    finally:
        took_s = time.monotonic() - began
        stopped.signal(signal.SIGCONT)
        openvswitch.vsctl("--if-exists", "del-br", "s7")
    assert took_s < VSCTL_TIMEOUT_S


@pytest.mark.usefixtures("no_open_vswitch")
def test_a_daemon_that_a_signal_stops_while_it_starts_is_named() -> None:
    def stop() -> None:
        wait_until(lambda: openvswitch.DATABASE in openvswitch.daemons(), "it has started")
        openvswitch.daemons()[openvswitch.DATABASE].signal(signal.SIGSTOP)

    stopping = threading.Thread(target=stop)
    stopping.start()
    try:
        with pytest.raises(
            NetworkError, match="ovsdb-server does not answer: a signal has stopped"
        ):
            openvswitch.start("tests")
    finally:
        stopping.join()
        openvswitch.stop_if_ours("tests")


@pytest.mark.usefixtures("no_open_vswitch")
@pytest.mark.parametrize("daemon", openvswitch.DAEMONS)
def test_a_daemon_that_a_signal_stops_while_it_is_to_end_ends_in_order(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, daemon: str
) -> None:
    control, said = tmp_path / "ovs-ctl", tmp_path / "said"
    stop = f"kill -STOP $(cat {openvswitch.RUN_FOLDER}/{daemon}.pid)"
    control.write_text(f"#!/bin/sh\n{stop}\n{openvswitch.CONTROL} stop >{said} 2>&1\n")
    control.chmod(0o755)
    openvswitch.start("tests")
    monkeypatch.setattr(openvswitch, "CONTROL", str(control))
    openvswitch.stop_if_ours("tests")
    assert not openvswitch.daemons()
    assert "SIGKILL" not in said.read_text()


@pytest.mark.usefixtures("no_open_vswitch")
def test_a_database_that_ends_as_it_is_asked_for_bridges_leaves_no_switch_daemon(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    openvswitch.start("tests")
    struck, asked = openvswitch.daemons()[openvswitch.DATABASE], openvswitch.bridges

    def bridges() -> list[str]:
        struck.signal(signal.SIGTERM)
        wait_until(lambda: not struck.alive, "it has ended")
        return asked()

    monkeypatch.setattr(openvswitch, "bridges", bridges)
    openvswitch.stop_if_ours("tests")
    assert not struck.alive
    assert not openvswitch.daemons()


@pytest.mark.usefixtures("no_open_vswitch")
def test_a_database_that_ends_as_it_is_started_again_leaves_no_switch_daemon(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It is started to end in order, and ends when ovs-ctl asks it first."""
    command, struck = tmp_path / "ovs-vsctl", tmp_path / "struck"
    pid = openvswitch.RUN_FOLDER / f"{openvswitch.DATABASE}.pid"
    command.write_text(
        f"""#!/bin/sh
        case "$*" in *init*) [ -e {struck} ] || {{ touch {struck}; kill $(cat {pid}); }};; esac
        exec {shutil.which("ovs-vsctl")} "$@"
        """
    )
    command.chmod(0o755)
    openvswitch.start("tests")
    openvswitch.daemons()[openvswitch.DATABASE].signal(signal.SIGTERM)
    wait_until(lambda: openvswitch.DATABASE not in openvswitch.daemons(), "it is gone")
    monkeypatch.setenv("PATH", f"{tmp_path}:{os.environ['PATH']}")
    openvswitch.stop_if_ours("tests")
    assert struck.exists()
    assert not openvswitch.daemons()


@pytest.mark.usefixtures("no_open_vswitch")
def test_a_database_that_its_monitor_has_started_again_is_stopped_all_the_same(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    openvswitch.start("tests")
    crashed, asked = openvswitch.daemons()[openvswitch.DATABASE], openvswitch.bridges

    def is_another() -> bool:
        return openvswitch.daemons().get(openvswitch.DATABASE, crashed) != crashed

    def bridges() -> list[str]:
        if crashed.alive:
            crashed.signal(signal.SIGSEGV)
            wait_until(is_another, "its monitor has started another")
            openvswitch.require_alive({openvswitch.DATABASE: crashed})
        return asked()

    monkeypatch.setattr(openvswitch, "bridges", bridges)
    openvswitch.stop_if_ours("tests")
    assert not openvswitch.daemons()


@pytest.mark.usefixtures("no_open_vswitch")
def test_a_daemon_that_ends_while_it_is_started_is_named_and_nothing_waits_for_it() -> None:
    def strike() -> None:
        wait_until(openvswitch.daemons, "the database runs")
        openvswitch.daemons()[openvswitch.DATABASE].signal(signal.SIGTERM)

    began = time.monotonic()
    striker = threading.Thread(target=strike)
    striker.start()
    try:
        with pytest.raises(NetworkError, match=openvswitch.DATABASE):
            openvswitch.start("tests")
        assert time.monotonic() - began < OPENVSWITCH_TIMEOUT_S / 2
    finally:
        striker.join()
        openvswitch.start("tests")
        openvswitch.stop_if_ours("tests")


@pytest.mark.usefixtures("no_open_vswitch")
@pytest.mark.parametrize("daemon", openvswitch.DAEMONS)
def test_a_daemon_that_a_signal_stops_while_bridges_go_lets_them_go(daemon: str) -> None:
    openvswitch.start("tests")
    add("s8", "q8")
    openvswitch.revive_if_ours("tests")
    openvswitch.daemons()[daemon].signal(signal.SIGSTOP)
    openvswitch.vsctl("del-br", "q8")
    openvswitch.daemons()[daemon].signal(signal.SIGSTOP)
    openvswitch.delete_finally("tests", "s8")
    openvswitch.stop_if_ours("tests")
    assert not openvswitch.daemons()


def test_a_daemon_of_somebody_else_is_not_started_again(tmp_path: Path) -> None:
    """Where the switches' daemon is not ours to start, their interfaces go all the same."""
    output = struck(tmp_path, openvswitch.SWITCH_DAEMON, signal.SIGTERM)
    try:
        assert openvswitch.SWITCH_DAEMON not in openvswitch.daemons()
        assert "died in mid-run" in output
        assert not interfaces() & {"s1", "q1"}
        again = qmn("--message", "x", runs=tmp_path)
        assert again.returncode == 1
        assert "Open vSwitch runs in part: ovs-vswitchd does not run: restart" in again.stderr
    finally:
        openvswitch.start("tests")


@pytest.mark.waits
@pytest.mark.usefixtures("no_open_vswitch")
def test_a_database_that_has_crashed_at_the_start_and_comes_back_later_is_stopped(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """After the second crash its monitor waits for 10 s, in which nothing says whose it is."""
    control = tmp_path / "ovs-ctl"
    pid = openvswitch.RUN_FOLDER / f"{openvswitch.DATABASE}.pid"
    control.write_text(
        f"""#!/bin/bash
        {openvswitch.CONTROL} start --no-ovs-vswitchd
        first=$(cat {pid})
        kill -SEGV $first
        while [[ $(cat {pid}) == $first ]]; do sleep 0.01; done
        kill -SEGV $(cat {pid})
        while [[ -e /proc/$(cat {pid}) ]]; do sleep 0.01; done
        echo 'ovs-vsctl: database connection failed' >&2
        exit 1
        """
    )
    control.chmod(0o755)
    with monkeypatch.context() as patch:
        patch.setattr(openvswitch, "CONTROL", str(control))
        with pytest.raises(NetworkError, match="ovsdb-server does not answer: "):
            openvswitch.start("tests")
    assert not openvswitch.daemons()
    openvswitch.stop_if_ours("tests")
    assert not openvswitch.daemons()
    assert not openvswitch._watched_over()


@pytest.mark.usefixtures("no_open_vswitch")
def test_what_never_came_is_not_started_to_be_stopped(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    control = tmp_path / "ovs-ctl"
    control.write_text(f"#!/bin/sh\necho $1 >>{tmp_path}/asked\nexit 1\n")
    control.chmod(0o755)
    monkeypatch.setattr(openvswitch, "CONTROL", str(control))
    with pytest.raises(NetworkError):
        openvswitch.start("tests")
    openvswitch.stop_if_ours("tests")
    assert (tmp_path / "asked").read_text() == "start\n"
    assert openvswitch.starter() == ""


@pytest.mark.waits
@pytest.mark.usefixtures("no_open_vswitch")
def test_a_database_of_somebody_else_that_comes_back_is_not_made_whole() -> None:
    """Its monitor starts it only 10 s after the crash before: until then nothing runs."""
    subprocess.run([openvswitch.CONTROL, "start"], check=True, capture_output=True)
    try:
        first = openvswitch.daemons()
        first[openvswitch.DATABASE].signal(signal.SIGSEGV)
        wait_until(lambda: not first[openvswitch.DATABASE].alive, "it has ended")
        wait_until(lambda: openvswitch.daemons().keys() == first.keys(), "it has come back")
        second = openvswitch.daemons()
        second[openvswitch.DATABASE].signal(signal.SIGSEGV)
        second[openvswitch.SWITCH_DAEMON].signal(signal.SIGTERM)
        wait_until(lambda: not openvswitch.daemons(), "all have ended")
        with pytest.raises(NetworkError, match="in part: ovs-vswitchd does not run"):
            openvswitch.start("tests")
        assert openvswitch.daemons().keys() == {openvswitch.DATABASE}
    finally:
        subprocess.run([openvswitch.CONTROL, "stop"], check=True, capture_output=True)


def test_bridges_that_cannot_be_removed_are_named_and_go_later(tmp_path: Path) -> None:
    output = struck(tmp_path, openvswitch.DATABASE, signal.SIGTERM)
    try:
        assert "ovsdb-server died in mid-run" in output
        assert "bridges q1, s1 stay, as ovsdb-server does not run" in output
    finally:
        openvswitch.start("tests")
    owner = openvswitch.owner_of("q1")
    assert (run := from_words(owner)) is not None
    assert not run.alive
    assert qmn("--message", "x", runs=tmp_path).returncode == 0
    assert openvswitch.bridges() == []


def test_bridges_that_the_switch_daemon_still_has_are_not_taken_for_new_ones(
    tmp_path: Path,
) -> None:
    """Its database comes back and loses them before it asks again, which it does more rarely."""
    struck(tmp_path, openvswitch.DATABASE, signal.SIGTERM)
    openvswitch.start("tests")
    openvswitch.vsctl(openvswitch.NO_WAIT, "del-br", "q1", "--", "del-br", "s1")
    assert qmn("--message", "x", runs=tmp_path).returncode == 0
    assert openvswitch.bridges() == []


@pytest.mark.usefixtures("no_open_vswitch")
def test_a_switch_daemon_that_has_not_seen_its_database_has_no_bridges(tmp_path: Path) -> None:
    """Sockets of bridges are left by one that was killed; this one does not know the question."""
    left = openvswitch.RUN_FOLDER / "q7.snoop"
    left.touch()
    command = ["ovs-vswitchd", f"unix:{tmp_path}/no-database", "--pidfile", "--no-chdir"]
    with subprocess.Popen(command, stderr=subprocess.DEVNULL) as process:
        try:
            wait_until(lambda: openvswitch.SWITCH_DAEMON in openvswitch.daemons(), "it runs")
            openvswitch.await_end(["q7"])
        finally:
            process.kill()
            left.unlink()


def test_a_killed_run_s_programs_that_are_stopped_are_ended_by_the_next(tmp_path: Path) -> None:
    """Told to end with the runner, a stopped one does not."""
    others = our_processes()
    with run_to_kill(tmp_path) as process:
        read_until(process, "sending")
        config = next(RUNTIME_ROOT.glob("*/alice.json"))
        for found in our_processes() - others:
            if str(config) in found:
                os.kill(int(found.split()[0]), signal.SIGSTOP)
        process.kill()
    wait_until(lambda: len(our_processes() - others) == 1, "only the stopped one is left")
    assert qmn("--message", "x", runs=tmp_path).returncode == 0
    assert our_processes() == others


def test_a_folder_that_is_not_of_a_run_is_left_alone(tmp_path: Path) -> None:
    """Neither one with a bare number, nor that of a process that has the number of another."""
    foreign = [RUNTIME_ROOT / name for name in ("4194000", "notes")]
    for folder in foreign:
        folder.mkdir(parents=True)
    reused = RUNTIME_ROOT / f"{os.getpid()}-1-00000000"  # our id, another process
    reused.mkdir()
    (reused / "switches").write_text("s1")
    try:
        assert qmn("--message", "x", runs=tmp_path).returncode == 0
        assert all(folder.exists() for folder in foreign)
        assert not reused.exists()
    finally:
        for folder in foreign:
            folder.rmdir()


@pytest.mark.usefixtures("no_open_vswitch")
def test_daemons_of_a_run_that_was_killed_before_it_noted_them_are_the_next_one_s() -> None:
    killed = "4194304-1-00000000"  # no process has this id
    openvswitch.start(killed)
    (RUNTIME_ROOT / openvswitch.STARTED).unlink()
    assert openvswitch.starter() == killed
    openvswitch.adopt("tests")
    assert openvswitch.starter() == "tests"
    openvswitch.stop_if_ours("tests")
    assert not openvswitch.daemons()


@pytest.mark.usefixtures("no_open_vswitch")
@pytest.mark.parametrize("daemon", openvswitch.DAEMONS)
def test_what_is_left_of_it_stops_where_the_other_half_was_killed(daemon: str) -> None:
    openvswitch.start("tests")
    openvswitch.daemons()[daemon].signal(signal.SIGKILL)
    wait_until(lambda: daemon not in openvswitch.daemons(), f"{daemon} is gone")
    openvswitch.stop_if_ours("tests")
    assert not openvswitch.daemons()


WITHOUT_TUN = 'mount -t tmpfs nothing /dev/net && exec "$@"'


@pytest.mark.usefixtures("no_open_vswitch")
def test_a_bridge_that_cannot_be_made_is_told_with_the_remedy(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "qmn", "run", "sdc", "--runs", str(tmp_path)]
    done = subprocess.run(
        ["unshare", "--mount", "sh", "-c", WITHOUT_TUN, "sh", *command],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
        timeout=SOON_S,
    )
    assert done.returncode == 1
    assert (
        "qmn: Open vSwitch cannot make q1 without /dev/net/tun: "
        "in a container, give it --device=/dev/net/tun\n"
    ) in done.stderr


def add(*bridges: str) -> None:
    for bridge in bridges:
        openvswitch.vsctl("add-br", bridge, "--", "set", "bridge", bridge, "datapath_type=netdev")


@pytest.mark.skipif(openvswitch.datapath() != "user", reason="the kernel's datapath is quick")
@pytest.mark.usefixtures("no_open_vswitch")
def test_the_switch_daemon_that_a_run_has_started_ends_with_its_last_bridges() -> None:
    """It deletes no port itself: that would take time with the square of the ports."""
    openvswitch.start("tests")
    add("s7", "q7")
    first = openvswitch.daemons()
    openvswitch.delete_finally("tests", "s7", "q7")
    assert not first[openvswitch.SWITCH_DAEMON].alive
    assert first[openvswitch.DATABASE].alive
    assert openvswitch.bridges() == []
    assert not interfaces() & {"s7", "q7"}
    openvswitch.revive_if_ours("tests")
    assert openvswitch.daemons().keys() == set(openvswitch.DAEMONS)
    openvswitch.stop_if_ours("tests")


@pytest.mark.usefixtures("no_open_vswitch")
def test_no_interface_stays_of_an_open_vswitch_that_a_run_has_started(tmp_path: Path) -> None:
    before = interfaces()
    with long_run(tmp_path) as process:
        read_until(process, "sending")
        assert openvswitch.DATAPATH_INTERFACE in interfaces() or openvswitch.datapath() != "user"
        process.send_signal(signal.SIGINT)
        process.finish(SAID_IN_S)
    assert interfaces() == before


@pytest.mark.usefixtures("no_open_vswitch")
def test_clean_removes_what_a_killed_run_and_its_killed_daemons_have_left(tmp_path: Path) -> None:
    before, others = interfaces(), our_processes()
    with run_to_kill(tmp_path) as process:
        read_until(process, "sending")
        process.kill()
    for daemon in openvswitch.daemons().values():
        daemon.signal(signal.SIGKILL)
    wait_until(lambda: not openvswitch.daemons(), "they are gone")
    wait_until(lambda: our_processes() == others, "the end of its programs")
    done = verb("clean")
    assert "removed Open vSwitch, started by run" in done.stdout
    assert openvswitch.daemons() == {}
    assert interfaces() == before
    assert verb("clean").stdout == "nothing of ours is left\n"


@pytest.mark.skipif(openvswitch.datapath() != "user", reason="the kernel's datapath is quick")
@pytest.mark.usefixtures("no_open_vswitch")
@pytest.mark.parametrize(("owner", "others"), [("tests", {"s8"}), ("another run", set[str]())])
def test_the_switch_daemon_goes_on_for_others(owner: str, others: set[str]) -> None:
    openvswitch.start("tests")
    add("s7", *others)
    first = openvswitch.daemons()
    openvswitch.delete_finally(owner, "s7")
    assert openvswitch.daemons() == first
    assert set(openvswitch.bridges()) == others
    assert interfaces() & {"s7", "s8"} == others
    openvswitch.delete(*others)
    openvswitch.stop_if_ours("tests")


@pytest.mark.usefixtures("no_open_vswitch")
def test_bridges_go_although_the_database_has_just_ended() -> None:
    """It was killed when the run's clean-up had already seen that both daemons run."""
    openvswitch.start("tests")
    add("s7", "q7")
    openvswitch.daemons()[openvswitch.DATABASE].signal(signal.SIGKILL)
    wait_until(lambda: openvswitch.DATABASE not in openvswitch.daemons(), "it is gone")
    openvswitch.delete_finally("tests", "s7", "q7")
    openvswitch.stop_if_ours("tests")
    assert not openvswitch.daemons()
    assert not interfaces() & {"s7", "q7"}


@pytest.mark.usefixtures("no_open_vswitch")
def test_no_change_waits_for_a_switch_daemon_that_ended_before(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(openvswitch, "VSCTL_TIMEOUT_S", 3600.0)
    openvswitch.start("tests")
    openvswitch.daemons()[openvswitch.SWITCH_DAEMON].signal(signal.SIGKILL)
    wait_until(lambda: openvswitch.SWITCH_DAEMON not in openvswitch.daemons(), "it is gone")
    with pytest.raises(NetworkError, match="ovs-vswitchd does not run: restart Open vSwitch"):
        openvswitch.vsctl("add-br", "s7")
    assert openvswitch.bridges() == ["s7"]
    openvswitch.start("tests")
    openvswitch.delete("s7")
    openvswitch.stop_if_ours("tests")
    assert not openvswitch.daemons()


@pytest.mark.usefixtures("no_open_vswitch")
def test_a_run_with_certificates_ends_well_with_an_open_vswitch_of_its_own(tmp_path: Path) -> None:
    """Its switch daemon ends with the bridges, and the certificate is taken away behind it."""
    done = qmn("--tls", runs=tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr


def test_runs_of_bridges_are_told_by_one_question() -> None:
    add("s7", "s8")
    openvswitch.vsctl("set", "bridge", "s8", f"{openvswitch.OWNER}=1-2-abc")
    try:
        assert openvswitch.runs_of_bridges() == {"s7": "", "s8": "1-2-abc"}
    finally:
        openvswitch.delete("s7", "s8")
