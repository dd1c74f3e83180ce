"""A run of many small blocks, with a page that looks at it or without, and what it took."""

import json
import os
import re
import subprocess
import time
from dataclasses import dataclass
from pathlib import Path

from page import Sample, looked_at
from replay import replayed

ROOT = Path(__file__).resolve().parents[2]
QMN = str(ROOT / "bin" / "qmn")
# Blocks are as small as frames allow, so that there are as many events as can be.
SENT = ("--block-pairs", "128", "--frame-bytes", "8", "--no-report", "--captures", "none")
DEADLINE_S = 60.0
POLL_S = 0.1


@dataclass(frozen=True)
class Measured:
    """What a run did, and what it took."""

    folder: Path
    pairs_per_s: float
    cpu_s_per_pair: float  # of all its programs, the live view not among them
    events_per_s: float
    page: Sample | None


def run(
    folder: Path, message: Path, page: bool = False, beside: Measured | None = None
) -> Measured:
    """Do a run; a page is served by `qmn live`, as from another terminal.

    `beside` is a run whose events a page shows meanwhile, as fast as they came: it takes as much of
    the machine as one of this run, and nothing of its network.
    """
    command = [QMN, "run", "sdc", "--file", str(message), *SENT, "--runs", str(folder)]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL) as network:
        sample = None
        if page:
            sample = look(network)
        elif beside is not None:
            with replayed(beside.folder, round(beside.events_per_s)) as (address, server):
                sample = looked_at(address, DEADLINE_S, server, lambda: has_ended(network.pid))
        _pid, status, usage = os.wait4(network.pid, 0)
        network.returncode = os.waitstatus_to_exitcode(status)
    assert network.returncode == 0, f"{' '.join(command)}: status {network.returncode}"
    latest = (folder / "latest").resolve()
    sent = json.loads((latest / "result.json").read_text())["job"]["asking"]
    events = len((latest / "quantum.log").read_bytes().splitlines())
    return Measured(
        latest,
        sent["pairs_per_s"],
        (usage.ru_utime + usage.ru_stime) / sent["bell_pairs"],
        events * sent["pairs_per_s"] / sent["bell_pairs"],
        sample,
    )


def has_ended(pid: int) -> bool:
    """Return whether a child has, which is still to be waited for."""
    ended = os.waitid(os.P_PID, pid, os.WEXITED | os.WNOHANG | os.WNOWAIT)
    return ended is not None


def look(network: "subprocess.Popen[bytes]") -> Sample:
    """Open a page of the network as soon as there is one, and look at it to its end."""
    deadline = time.monotonic() + DEADLINE_S
    while time.monotonic() < deadline and network.poll() is None:
        view = subprocess.Popen(
            [QMN, "live"], stdout=subprocess.PIPE, text=True, stderr=subprocess.PIPE
        )
        with view:
            assert view.stdout is not None
            try:
                if found := re.search(r"http\S+", view.stdout.readline()):
                    return looked_at(found[0], DEADLINE_S, view.pid)
            finally:
                view.terminate()
        time.sleep(POLL_S)
    raise AssertionError(f"no network within {DEADLINE_S:.0f} s")
