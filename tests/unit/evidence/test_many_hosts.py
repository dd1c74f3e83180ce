"""Benchmarks of networks of many hosts: processor time and memory as the kernel counts them."""

import argparse
import os
import subprocess
import sys
import time

import pytest
from limits import SOON_S

from evidence.kinds.bench import sizes
from topologies.system.namespaces import in_own_namespaces
from topologies.system.processes.owners import this_process

SHARE = """
import os, time
from evidence.bench.many_hosts import shared_memory_mb
print(shared_memory_mb())
kept = b"x" * (50 << 20)
print(shared_memory_mb())
if not os.fork():
    time.sleep(60)
print(shared_memory_mb())
"""


def test_processor_time_is_that_of_the_kernel() -> None:
    before = time.process_time()
    report = this_process().processor_s
    tick_s = 1 / os.sysconf("SC_CLK_TCK")
    assert before - 2 * tick_s <= report <= time.process_time() + 2 * tick_s


@pytest.mark.nightly
@pytest.mark.skipif(os.geteuid() != 0, reason="only root makes namespaces")
def test_memory_is_that_of_all_processes_each_page_once() -> None:
    """Of two that share 50 MiB, after a fork, these count once."""
    done = subprocess.run(
        in_own_namespaces([sys.executable, "-c", SHARE]),
        capture_output=True,
        text=True,
        check=True,
        timeout=SOON_S,
    )
    before, alone, shared = map(float, done.stdout.split())
    assert 50 <= alone - before <= 60
    assert shared - alone < 25  # of a second interpreter, without what it shares


@pytest.mark.parametrize("text", ["2", "4,1025", "4,", "many", "-4"])
def test_sizes_of_networks_that_cannot_be_are_refused(text: str) -> None:
    with pytest.raises(argparse.ArgumentTypeError, match="numbers of hosts are 3 to 1024"):
        sizes(text)
    assert sizes("4,1024") == (4, 1024)
