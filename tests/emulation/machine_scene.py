"""A second machine for networks over several: here network, processes and /run of their own.

this one, m1: 192.0.2.1 ---- 192.0.2.2: m2, with a worker
"""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from distributed import LocalCluster
from limits import SOON_S, wait_until

from evidence.curves.cluster import HTTP_ADDRESS
from topologies.system.confinement.confinement import descendants
from topologies.system.namespaces import OWN_NAMESPACES
from topologies.system.processes.programs import ROOT

HERE, THERE, PORT = "192.0.2.1", "192.0.2.2", 8786
SCHEDULER = f"tcp://{HERE}:{PORT}"
WORKER = f"exec {sys.executable} -m qmn worker {SCHEDULER} --name m2"
ON_SECOND = ("--machines", "2", "--place", "bob=m2", "--scheduler", SCHEDULER)


@dataclass
class SecondMachine:
    """The other machine."""

    keeper: int  # the process that keeps its namespaces, by its id here
    worker: subprocess.Popen[str]

    def says(self, *command: str) -> str:
        """Return what a command says there."""
        enter = ["nsenter", f"--target={self.keeper}", "--all", *command]
        return subprocess.run(
            enter, capture_output=True, text=True, check=True, timeout=SOON_S
        ).stdout

    def things(self) -> tuple[list[str], list[str], str]:
        """Return its processes but the worker, its interfaces, and what is in /run."""
        listed = self.says("ps", "-e", "-o", "args=").splitlines()
        found = sorted(each for each in listed if "ps -e" not in each and "qmn worker" not in each)
        links = sorted(each["ifname"] for each in json.loads(self.says("ip", "-json", "link")))
        return found, links, self.says("ls", "/run")

    def require_only(self, before: tuple[list[str], list[str], str]) -> None:
        """Check that soon nothing has been added."""
        deadline = time.monotonic() + 5
        while (now := self.things()) != before and time.monotonic() < deadline:
            time.sleep(0.02)
        assert now == before


def inside(pid: int) -> list[int]:
    """Return the processes below one that are in another namespace of processes."""
    here = os.readlink("/proc/self/ns/pid")
    found = []
    for each in descendants(pid):
        with suppress(FileNotFoundError, ProcessLookupError):  # it has ended
            if os.readlink(f"/proc/{each}/ns/pid") != here:
                found.append(each)
    return found


@contextmanager
def second_machine(folder: Path) -> Iterator[SecondMachine]:
    """Join this machine with another, on which a worker is ready; its log is in the folder."""
    ip("link add under1 type veth peer name under2")
    pipe = subprocess.PIPE
    with subprocess.Popen([OWN_NAMESPACES, "sleep", "infinity"], stdin=pipe) as holder:
        wait_until(lambda: len(inside(holder.pid)) == 2, "namespaces")
        keeper = inside(holder.pid)[0]
        enter = ["nsenter", f"--target={keeper}", "--all"]
        ip(f"addr add {HERE}/24 dev under1", "link set under1 up")
        ip(f"link set under2 netns {keeper}")
        for words in (f"addr add {THERE}/24 dev under2", "link set under2 up"):
            subprocess.run([*enter, "ip", *words.split()], check=True, timeout=SOON_S)
        log = folder / "worker.log"
        try:
            with (
                LocalCluster(
                    n_workers=0,
                    protocol="tcp",
                    host=HERE,
                    scheduler_port=PORT,
                    dashboard_address=HTTP_ADDRESS,
                    scheduler_kwargs={"dashboard": False},
                ),
                log.open("w") as output,
                subprocess.Popen(
                    [*enter, f"--wd={ROOT}", "bash", "-c", WORKER],
                    stdout=output,
                    stderr=output,
                    text=True,
                    env={**os.environ, "PYTHONPATH": str(ROOT)},
                ) as worker,
            ):
                try:
                    wait_until(lambda: "ready" in log.read_text(), f"ready: {log}")
                    yield SecondMachine(keeper, worker)
                finally:
                    for pid in descendants(worker.pid):
                        os.kill(pid, signal.SIGKILL)
        finally:
            ip("link delete under1")
            holder.kill()


def ip(*commands: str) -> None:
    for words in commands:
        subprocess.run(["ip", *words.split()], check=True, timeout=SOON_S)
