"""The machine beside a run: seen with the machine's own tools, none of ours."""

import os
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

COMMAND_TIMEOUT_S = 70.0
SETTLE_S = 6.0  # that processes may take to go once their run has ended
DAEMONS = ("ovsdb-server", "ovs-vswitchd")
FOREIGN_LINK = ("s9-eth1", "s9-eth2")  # names as a switch's of ours would be
FOREIGN_NAMESPACE = "chaosns"
FOREIGN_FOLDER = Path("/run/qmn/4194000")  # as a run's of old; not ours


@dataclass(frozen=True)
class Process:
    """A process as it is now."""

    pid: int
    parent: int
    command: tuple[str, ...]


def slowness() -> float:
    """Return how many processes share a processor now; 1 where none waits for one."""
    return max(1.0, os.getloadavg()[0] / (os.cpu_count() or 1))


def slowed(*pids: int) -> float | None:
    """Return how many times as long as alone processes have taken for what they have done so far.

    The kernel counts for how long each task ran, and for how long it could have. None if all are
    gone.
    """
    ran = waited = 0
    for pid in pids:
        with suppress(OSError):
            for task in Path(f"/proc/{pid}/task").iterdir():
                times = (task / "schedstat").read_text().split()
                ran, waited = ran + int(times[0]), waited + int(times[1])
    return 1 + waited / ran if ran else None


def run(*command: str) -> str:
    """Run a command; return what it prints."""
    done = subprocess.run(
        command, capture_output=True, text=True, check=True, timeout=COMMAND_TIMEOUT_S
    )
    return done.stdout


def fill(file: Path) -> None:
    """Write a file until its disk is full."""
    with suppress(OSError), file.open("wb", buffering=0) as opened:
        while True:
            opened.write(bytes(512))


def processes() -> Iterator[Process]:
    """Yield all processes that run; those that only wait to be asked how they ended do not."""
    for folder in Path("/proc").iterdir():
        if not folder.name.isdigit():
            continue
        try:
            fields = (folder / "stat").read_text().rpartition(")")[2].split()
            words = (folder / "cmdline").read_bytes().decode(errors="replace").split("\0")
        except OSError:
            continue
        if fields[0] not in "ZX":
            yield Process(int(folder.name), int(fields[1]), tuple(words[:-1]))


def descendants(pid: int) -> list[Process]:
    """Return what a process has started, and what that has."""
    everybody = list(processes())
    found, wanted = [], {pid}
    while wanted:
        children = [process for process in everybody if process.parent in wanted]
        found += children
        wanted = {process.pid for process in children}
    return found


def network_of(run: int) -> int | None:
    """Return a process in the network in which a run has its switches; None if there is none."""
    for process in descendants(run):
        if process.command[:1] == (DAEMONS[1],):
            return process.pid
    return None


def runner_of(keeper: int) -> int:
    """Return the process that builds a network: two below who keeps its namespaces."""
    found = keeper
    for _ in range(2):
        found = next((each.pid for each in processes() if each.parent == found), found)
    return found


def _until_inside(pid: int) -> None:
    """Wait until a process is in a network namespace of its own: from then on it is seen there."""
    deadline = time.monotonic() + COMMAND_TIMEOUT_S
    own = os.readlink("/proc/self/ns/net")
    while os.readlink(f"/proc/{pid}/ns/net") == own and time.monotonic() < deadline:
        time.sleep(0.01)


@contextmanager
def foreign_things(mark: str) -> Iterator[None]:
    """Make what is not ours, some of it with names such as ours; check that it is still there."""
    run("ip", "link", "add", FOREIGN_LINK[0], "type", "veth", "peer", "name", FOREIGN_LINK[1])
    run("ip", "netns", "add", FOREIGN_NAMESPACE)
    FOREIGN_FOLDER.mkdir(parents=True)
    bystander = ["ip", "netns", "exec", FOREIGN_NAMESPACE, "sleep", mark]
    with subprocess.Popen(bystander) as process:
        try:
            _until_inside(process.pid)
            yield
        finally:
            process.kill()
            run("ip", "netns", "del", FOREIGN_NAMESPACE)
            run("ip", "link", "del", FOREIGN_LINK[0])
            FOREIGN_FOLDER.rmdir()


def harm(mark: str) -> list[str]:
    """Return which foreign things have gone."""
    there = {
        f"interface {FOREIGN_LINK[0]}": Path("/sys/class/net", FOREIGN_LINK[0]).exists(),
        f"namespace {FOREIGN_NAMESPACE}": Path("/run/netns", FOREIGN_NAMESPACE).exists(),
        f"folder {FOREIGN_FOLDER}": FOREIGN_FOLDER.exists(),
        "process sleep": any(process.command == ("sleep", mark) for process in processes()),
    }
    return [name for name, still in there.items() if not still]


def things() -> dict[str, set[str]]:
    """Return the names of what a network makes on a machine, and the kernel is to take away."""
    return {
        "interfaces": set(os.listdir("/sys/class/net")),
        "folders": {path.name for path in Path("/run/qmn").glob("*")},
        "programs": {
            f"{process.pid} {' '.join(process.command)[:100]}"
            for process in processes()
            if any(word in " ".join(process.command) for word in ("mininet:", "/run/qmn/"))
            or process.command[:1] in {("tcpdump",), *((name,) for name in DAEMONS)}
        },
        "namespaces": {
            line.split()[0] for line in run("lsns", "-t", "net", "-n", "-o", "NS").splitlines()
        },
    }


def left(before: dict[str, set[str]]) -> list[str]:
    """Return what has come and what is gone, when all has settled."""
    deadline = time.monotonic() + SETTLE_S
    while (now := things()) != before and time.monotonic() < deadline:
        time.sleep(0.1)
    more = [(f"{kind} left", now[kind] - before[kind]) for kind in now]
    less = [(f"{kind} gone", before[kind] - now[kind]) for kind in now]
    return [f"{what}: {', '.join(sorted(names))}" for what, names in more + less if names]
