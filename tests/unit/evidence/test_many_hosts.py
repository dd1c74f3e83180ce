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
from evidence.bench.many_hosts import network_memory_mb
print(network_memory_mb())
kept = b"x" * (50 << 20)
print(network_memory_mb())
for _ in range(2):
    if not os.fork():
        time.sleep(60)
    print(network_memory_mb())
"""


def test_processor_time_is_that_of_the_kernel() -> None:
    before = time.process_time()
    report = this_process().processor_s
    tick_s = 1 / os.sysconf("SC_CLK_TCK")
    assert before - 2 * tick_s <= report <= time.process_time() + 2 * tick_s


@pytest.mark.nightly
@pytest.mark.skipif(os.geteuid() != 0, reason="only root makes namespaces")
def test_memory_is_that_of_all_other_processes_each_page_once() -> None:
    """This one keeps 50 MiB: half of it counts for one that shares it, a third for each of two."""
    done = subprocess.run(
        in_own_namespaces([sys.executable, "-c", SHARE]),
        capture_output=True,
        text=True,
        check=True,
        timeout=SOON_S,
    )
    before, alone, with_one, with_two = map(float, done.stdout.split())
    assert alone - before < 5
    assert with_one - alone >= 26
    assert with_two - alone < 1.6 * (with_one - alone)


@pytest.mark.parametrize("text", ["2", "4,1025", "4,", "many", "-4"])
def test_sizes_of_networks_that_cannot_be_are_refused(text: str) -> None:
    with pytest.raises(argparse.ArgumentTypeError, match="numbers of hosts are 3 to 1024"):
        sizes(text)
    assert sizes("4,1024") == (4, 1024)
