"""The cause of an end is named: a link, a bridge, flow entries or room on a disk are gone."""

import os
import re
import resource
import subprocess
import sys
from pathlib import Path

import pytest
from conftest import ROOT, qmn_words
from limits import PROGRAM_S
from test_faults import SLOW, child, long_run, read_until

from topologies.networks.network import Network
from topologies.system.processes.programs import python

# In a mount namespace of its own, where the folder of the run is on a small disk.
ON_SMALL_DISK = ("unshare", "--mount", "--propagation=private", "sh", "-c")


@pytest.mark.by_day(every=2)
@pytest.mark.waits
@pytest.mark.parametrize(
    ("strike", "cause"),
    [
        ("ip link del s1-eth1", "the copper link alice-eth0 to s1-eth1 was deleted in mid-run"),
        ("ip link del q1-eth2", "the fibre alice-q0 to q1-eth2 was deleted in mid-run"),
        ("ovs-vsctl --timeout=10 del-br s1", "bridge s1 was deleted in mid-run"),
        (
            "ovs-ofctl -O OpenFlow14 del-flows s1",
            "bridge s1 has no flow entries, and drops all packets",
        ),
    ],
)
def test_what_was_deleted_is_the_cause(tmp_path: Path, strike: str, cause: str) -> None:
    with long_run(tmp_path) as run:
        read_until(run, "sending long")
        inside = f"--target={child(run, 'ovs-vswitchd')}"
        subprocess.run(["nsenter", inside, "--net", "--mount", *strike.split()], check=True)
        shown = run.finish(PROGRAM_S)
    assert run.returncode == 1
    (ending,) = re.findall("ending: (.*)", shown)
    assert ending.startswith(cause)


def test_what_is_removed_in_order_is_no_fault(network: Network) -> None:
    """By Mininet's own verbs: `py net.delLinkBetween(…)`, `switch s1 stop`."""
    s1, ed = network.net.get("s1", "ed")
    network.net.delLinkBetween(ed, s1)
    network.explain()
    s1.stop(deleteIntfs=False)
    network.explain()


@pytest.mark.by_day(every=2)
@pytest.mark.parametrize("size", ["size=12M", "size=12M,nr_inodes=60"])
def test_a_full_disk_is_the_cause(tmp_path: Path, size: str) -> None:
    """One error of the kernel for both, ENOSPC: tmpfs(5)."""
    (tmp_path / "long").write_bytes(bytes(40 << 20))
    runs = tmp_path / "runs"
    runs.mkdir()
    words = [*qmn_words(runs), "--file", str(tmp_path / "long"), *SLOW]
    script = f'mount -t tmpfs -o {size} tmpfs {runs} && exec "$@"'
    done = subprocess.run(
        [*ON_SMALL_DISK, script, "sh", sys.executable, "-m", "qmn", *words],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=PROGRAM_S,
        check=False,
    )
    assert done.returncode == 1
    assert "Traceback" not in done.stderr
    assert re.search("nearly full|no room for another file|No space left", done.stderr)


def test_a_limit_of_open_files_is_named_before_the_start(tmp_path: Path) -> None:
    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_NOFILE, (256, 256))

    done = subprocess.run(
        [python(), "-m", "qmn", *qmn_words(tmp_path / "runs")],
        cwd=ROOT,
        env=os.environ,
        preexec_fn=limit,
        capture_output=True,
        text=True,
        timeout=PROGRAM_S,
        check=False,
    )
    text = "qmn: this process may open 256 files, a network needs 1024: raise the hard limit "
    assert (done.returncode, done.stderr) == (1, f"{text}(`ulimit -Hn 1024`)\n")
    assert not (tmp_path / "runs").exists()
