"""qmn run --machines: hosts on another machine (machine_scene.py)."""

import json
import os
import random
import signal
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from conftest import ROOT, wait_until
from fabric_scene import STANDING
from limits import PROGRAM_S, SOON_S
from machine_scene import ON_SECOND, SCHEDULER, THERE, SecondMachine
from test_tls import firsts

from qmn.machines.workers import on_machines
from topologies.system.confinement.confinement import descendants
from topologies.system.kernel.interfaces import TUN
from topologies.system.machines.agent import MODULE as AGENT
from topologies.system.machines.tunnel import NO_SUCH_KIND, TUNNELS
from topologies.system.machines.user_space import MAY_NOT
from wire.config import DISPATCHER_PORT
from wire.pcapng import PcapReader

SEED, BYTES = 7, 20_000
NOISY = ("--depolarizing", "0.0005", "--loss-db-per-km", "0.02", "--frame-bytes", "32")
LOST_WITHIN_S = 20.0  # 5 s until a machine is lost that says nothing, and the end of a network


def command(runs: Path, file: Path, *words: str) -> list[str]:
    """Return that of a run with noise, whose bytes are those of a file."""
    job = ["run", "sdc", "--file", str(file), "--seed", str(SEED), "--runs", str(runs)]
    return [sys.executable, "-m", "qmn", *job, *NOISY, *words]


def message(folder: Path, size: int) -> Path:
    file = folder / "sent"
    file.write_bytes(random.Random(SEED).randbytes(size))
    return file


def events(run: Path) -> list[str]:
    """Return what happened to qubits, without when."""
    lines = (run / "quantum.log").read_text().splitlines()
    return sorted(line.split(maxsplit=1)[1] for line in lines)


def facts(run: Path) -> dict[str, Any]:
    """Return what a run says that time does not change."""
    result = json.loads((run / "result.json").read_text())
    same = ("bell_pairs", "lost_pairs", "symbol_errors", "repeated_frames")
    reports = {name: result["job"]["asking"][name] for name in same}
    return {**reports, "delivered": result["delivered"], "exact": result["exact"]}


def test_bob_on_a_second_machine_gets_what_he_gets_on_this_one(
    second: SecondMachine, tmp_path: Path
) -> None:
    file = message(tmp_path, BYTES)
    before = second.things()
    between = tmp_path / "between.pcap"
    with tcpdump(between):
        for name, words in (("one", ()), ("two", ON_SECOND)):
            done = subprocess.run(
                command(tmp_path / name, file, *words),
                cwd=ROOT,
                capture_output=True,
                text=True,
                check=False,
                timeout=PROGRAM_S,
            )
            assert done.returncode == 0, done.stderr
    one, two = tmp_path / "one" / "latest", tmp_path / "two" / "latest"
    assert (two / "received").read_bytes() == file.read_bytes()
    assert facts(one)["symbol_errors"] > 0
    assert facts(one)["lost_pairs"] > 0
    assert facts(two) == facts(one)
    assert events(two) == events(one)
    machine = json.loads((two / "result.json").read_text())["machines"]["m2"]
    assert (machine["address"], machine["hosts"]) == (THERE, ["bob"])
    # It has the same clock: so far apart do they seem by the way there and back at most.
    assert abs(machine["clock"]["offset_s"]) <= machine["clock"]["error_s"] < 0.1
    near, far = (packets(two / f"{name}.pcap") for name in (copper_of_bob(two), "bob-eth0"))
    seen = near.keys() & far.keys()
    assert len(seen) > 20
    limit_ns = 1e9 * (machine["clock"]["error_s"] + 0.5)
    assert all(abs(near[data] - far[data]) < limit_ns for data in seen)
    second.require_only(before)
    # Between machines hosts reach the dispatcher by TLS, whose records begin so (RFC 8446, 5.1).
    assert {data[:2] for data in firsts([two / "bob-eth0.pcap"], DISPATCHER_PORT)} == {b"\x16\3"}
    # So does the runner speak with its agent; who has the key log reads what it asks for.
    assert (two / "machines.keys").stat().st_mode & 0o777 == 0o600
    assert '"do": "start"' not in spoken(between)
    assert '"do": "start"' in spoken(between, f"-otls.keylog_file:{two / 'machines.keys'}")


@contextmanager
def tcpdump(file: Path) -> Iterator[None]:
    """Capture what goes by TCP between the machines."""
    words = ["tcpdump", "-i", "under1", "-U", "-Z", "root", "-w", str(file), "tcp"]
    with subprocess.Popen(words, stderr=subprocess.PIPE, text=True) as program:
        assert program.stderr is not None
        assert "listening" in program.stderr.readline()
        try:
            yield
        finally:
            program.send_signal(signal.SIGINT)
            program.communicate(timeout=10)


def spoken(file: Path, *words: str) -> str:
    """Return what Wireshark reads in the connections of a capture that go by TLS."""
    tshark = ["tshark", "-r", str(file), *words]
    begins = [*tshark, "-Y", "tls.handshake.type == 1", "-T", "fields", "-e", "tcp.stream"]
    streams = subprocess.run(
        begins, capture_output=True, text=True, check=True, timeout=SOON_S
    ).stdout
    assert streams
    follow = [f"-zfollow,tls,ascii,{stream}" for stream in streams.split()]
    reports = [*tshark, "-q", *follow]
    return subprocess.run(
        reports, capture_output=True, text=True, check=True, timeout=SOON_S
    ).stdout


def packets(file: Path) -> dict[bytes, int]:
    """Return when each packet was captured that did not come twice."""
    with file.open("rb") as opened:
        found = list(PcapReader(opened).packets())
    often = Counter(packet.data for packet in found)
    return {packet.data: packet.time_ns for packet in found if often[packet.data] == 1}


def copper_of_bob(run: Path) -> str:
    """Return the interface of s1 that leads to bob."""
    copper = json.loads((run / "result.json").read_text())["network"]["copper"]
    (name,) = (at_s1 for one, _, _, at_s1 in copper if one == "bob")
    return str(name)


@pytest.mark.nightly
@pytest.mark.waits
def test_heavy_traffic_of_a_host_on_a_second_machine_is_that_of_one_machine(
    second: SecondMachine, tmp_path: Path
) -> None:
    """Sessions of a line of all hosts, the second when the first is over even on a busy machine."""
    before = second.things()
    trace = tmp_path / "trace.csv"
    rows = ["0,charlie,bob,alice", "6,bob,alice,charlie"]
    trace.write_text("\n".join(["at_s,opener,acceptor,others", *rows]) + "\n")
    hosts = "alice,bob,charlie"
    words = ["run", "load", "--service", "ghz", "--traffic", "trace", "--file", str(trace)]
    words += ["--from", hosts, "--to", hosts, "--contention", "queue", "--without", "report"]
    words += ["--depolarizing", "0.05", "--loss-db-per-km", "50", "--seed", str(SEED)]
    reports = {}
    by_open_vswitch = (*ON_SECOND, "--tunnels", "open-vswitch")
    for name, where in (("one", ()), ("two", ON_SECOND), ("ovs", by_open_vswitch)):
        done = subprocess.run(
            [sys.executable, "-m", "qmn", *words, *where, "--runs", str(tmp_path / name)],
            cwd=ROOT,
            capture_output=True,
            text=True,
            check=False,
            timeout=PROGRAM_S,
        )
        assert done.returncode == 0, done.stderr
        reports[name] = json.loads((tmp_path / name / "latest" / "result.json").read_text())
        sessions = reports[name]["job"]["load"]["sessions"]
        assert [each["outcome"] for each in sessions] == ["accepted"] * 2, sessions
    # Memories, which are ideal, also tell how long a qubit was in them.
    one, two, ovs = (
        [line.partition(" after ")[0] for line in events(tmp_path / name / "latest")]
        for name in reports
    )
    assert reports["one"]["photons_lost"] > 0
    assert two == ovs == one
    assert all(reports[name]["machines"]["m2"]["hosts"] == ["bob"] for name in ("two", "ovs"))
    second.require_only(before)
    links = subprocess.run(["ip", "-json", "link"], capture_output=True, text=True, check=True)
    assert {each["ifname"] for each in json.loads(links.stdout)} == {"lo", "under1"}


def test_a_kernel_says_so_that_it_has_no_interfaces_of_a_kind() -> None:
    words = ["ip", "link", "add", "none", "type", "nosuchkind"]
    done = subprocess.run(words, capture_output=True, text=True, check=False, timeout=10)
    assert NO_SUCH_KIND in done.stderr


def test_who_may_not_take_files_of_open_vswitch_is_told_so() -> None:
    report = "from topologies.system.machines import user_space as our; "
    report += f"our._let_interfaces_end_with({os.getpid()})"
    may_not = ["setpriv", "--bounding-set=-sys_ptrace", "--inh-caps=-sys_ptrace"]
    with open(TUN, "rb"):  # as its daemon has it; who asks has less rights than this process
        words = [*may_not, sys.executable, "-c", report]
        done = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, check=False)
    assert f"NetworkError: {MAY_NOT}" in done.stderr


@pytest.mark.by_day(every=2)
@pytest.mark.parametrize("tunnels", TUNNELS)
def test_a_worker_that_is_killed_ends_the_run_by_name_and_leaves_nothing(
    tunnels: str, second: SecondMachine, tmp_path: Path
) -> None:
    before = second.things()
    asking = tmp_path / "two" / "latest" / "asking.log"
    where = (*ON_SECOND, "--tunnels", tunnels)
    words = command(tmp_path / "two", message(tmp_path, 1 << 20), *where)
    pipe = subprocess.PIPE
    with subprocess.Popen(words, cwd=ROOT, stdout=pipe, stderr=pipe, text=True) as run:
        wait_until(lambda: asking.exists() and "delivered" in asking.read_text(), "bytes")
        assert any("-m hosts" in each for each in second.things()[0])
        os.kill(next(descendants(second.worker.pid)), signal.SIGKILL)
        STANDING.spoil()
        _said, complaint = run.communicate(timeout=LOST_WITHIN_S)
    assert run.returncode == 1
    assert f"the machine m2 ({THERE}) was lost" in complaint
    second.require_only(before)


@pytest.mark.waits
def test_an_agent_that_does_not_end_is_named_killed_and_waited_for(
    second: SecondMachine, caplog: pytest.LogCaptureFixture
) -> None:
    before = second.things()
    with on_machines(2, ["bob=m2"], SCHEDULER, ["alice", "bob"], None, lambda: None) as machines:
        assert list(machines) == ["bob"]
        (agent,) = (
            pid
            for pid in descendants(second.worker.pid)
            if arguments(pid)[1:4] == ["-P", "-m", AGENT]
        )
        os.kill(agent, signal.SIGSTOP)
    lines = [each.getMessage() for each in caplog.records if each.name == "mininet"]
    assert lines == ["m2: its agent had not ended after 5 s\n"]
    second.require_only(before)


def arguments(pid: int) -> list[str]:
    return Path(f"/proc/{pid}/cmdline").read_text().split("\0")


COMMANDS = """
alice ping -c 1 -q bob
bob ping -c 1 -q alice
qsend alice bob there by light
qsend bob alice and back
qstate bob
py network.send("bob", "alice", bytes(100_000)).size
bob hostname -I
bob ulimit -d unlimited 2>/dev/null || echo the limit stays
bob test -w /proc/fs || test -w /proc/sys/kernel/panic || echo the kernel stays
bob mount -t tmpfs none /mnt && echo it mounts
bob echo namespace $(readlink /proc/self/ns/user)
iperf alice bob
"""


def test_the_command_line_steers_a_host_of_a_second_machine(
    second: SecondMachine, tmp_path: Path
) -> None:
    before = second.things()
    words = ["cli", "ring,both_ways", "--runs", str(tmp_path), *ON_SECOND]
    done = subprocess.run(
        [sys.executable, "-m", "qmn", *words],
        input=COMMANDS,
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
        timeout=PROGRAM_S,
    )
    text = done.stdout
    assert text.count("1 packets transmitted, 1 received, 0% packet loss") == 2
    assert "bob: there by light" in text
    assert "alice: and back" in text
    assert "cut" not in text
    lines = set(text.splitlines())
    assert {"100000", "the limit stays", "the kernel stays", "it mounts"} <= lines
    (namespace,) = (line.split()[1] for line in lines if line.startswith("namespace "))
    assert namespace.startswith("user:[")
    assert namespace != os.readlink("/proc/self/ns/user")
    # Programs that cannot be there are refused by name, and no others.
    assert done.stderr.startswith("*** bob is on m2, where iperf "), done.stderr
    assert (done.returncode, done.stderr.count("***")) == (1, 1)
    machine = json.loads((tmp_path / "latest" / "result.json").read_text())["machines"]["m2"]
    assert (machine["address"], machine["hosts"]) == (THERE, ["bob"])
    second.require_only(before)
