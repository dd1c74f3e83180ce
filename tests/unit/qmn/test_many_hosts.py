"""Benchmarks of networks of many hosts: processor time and memory as the kernel counts them."""

import argparse
import os
import re
import subprocess
import sys
import time
from pathlib import Path

import pytest

from qmn.benchmarks.many_hosts import shared_memory_mb
from qmn.verbs.bench import sizes
from topologies.system.processes.owners import VARIABLE, this_process

RUN = "1-1-00000000"  # of no process that there is
KEEP = "import sys; kept = b'x' * (50 << 20); print(len(kept), flush=True); sys.stdin.read()"


def test_processor_time_is_that_of_the_kernel() -> None:
    before = time.process_time()
    told = this_process().processor_s
    tick_s = 1 / os.sysconf("SC_CLK_TCK")
    assert before - 2 * tick_s <= told <= time.process_time() + 2 * tick_s


def test_memory_is_that_of_the_processes_of_the_run() -> None:
    assert shared_memory_mb(RUN) == 0
    environment = {**os.environ, VARIABLE: RUN}
    pipe = subprocess.PIPE
    command = [sys.executable, "-c", KEEP]
    with subprocess.Popen(command, env=environment, stdin=pipe, stdout=pipe) as process:
        assert process.stdout is not None
        assert int(process.stdout.readline()) == 50 << 20
        told = shared_memory_mb(RUN)
        status = Path("/proc", str(process.pid), "status").read_text()
        resident = re.search(r"VmRSS:\s+(\d+) kB", status)
        process.communicate()
    assert resident is not None
    assert 50 * 1.048576 <= told <= int(resident[1]) * 1024 / 1e6


@pytest.mark.parametrize("text", ["2", "4,1025", "4,", "many", "-4"])
def test_sizes_of_networks_that_cannot_be_are_refused(text: str) -> None:
    with pytest.raises(argparse.ArgumentTypeError, match="numbers of hosts are 3 to 1024"):
        sizes(text)
    assert sizes("4,1024") == (4, 1024)
