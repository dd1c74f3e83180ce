"""The machine beside a run: seen with the machine's own tools, none of ours."""

import os
import signal
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

COMMAND_TIMEOUT_S = 70.0
ENDING_S = 1.0  # that a daemon may take to end
SETTLE_S = 6.0  # that processes may take to go once their run has ended
CONTROL = "/usr/share/openvswitch/scripts/ovs-ctl"
PID_FILES = Path("/var/run/openvswitch")
DAEMONS = ("ovsdb-server", "ovs-vswitchd")
FOREIGN_BRIDGE = "chaosbr"
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


def slowed(pid: int) -> float | None:
    """Return how many times as long as alone a process has taken for what it has done so far.

    The kernel counts for how long it ran, and for how long it could have. None if it is gone.
    """
    try:
        ran, waited = Path(f"/proc/{pid}/schedstat").read_text().split()[:2]
    except OSError:
        return None
    return 1 + int(waited) / max(1, int(ran))


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


def daemons() -> dict[str, int]:
    """Return the process ids of Open vSwitch's daemons that run."""
    found = {}
    for name in DAEMONS:
        with suppress(OSError, ValueError):
            pid = int((PID_FILES / f"{name}.pid").read_text())
            if Path(f"/proc/{pid}/comm").read_text().strip() == name:
                found[name] = pid
    return found


def monitors() -> dict[str, int]:
    """Return the processes that start a crashed daemon again."""
    return {
        f"{name} monitor": process.pid
        for process in processes()
        for name in DAEMONS
        if process.command[:1] and process.command[0].startswith(f"{name}: monitoring")
    }


def dumps_core(pid: int) -> bool:
    """Whether a process has crashed and still writes its memory to the disk."""
    with suppress(OSError):
        return "CoreDumping:\t1" in Path(f"/proc/{pid}/status").read_text()
    return False


def start_open_vswitch() -> None:
    """Start both daemons, or the one that is missing; let one go on that was stopped.

    Where the monitor of one that has crashed starts it just now, ovs-ctl fails. One that is just
    ending it takes for one that runs.
    """
    deadline = time.monotonic() + COMMAND_TIMEOUT_S
    while True:
        for pid in daemons().values():
            with suppress(ProcessLookupError):
                os.kill(pid, signal.SIGCONT)
        try:
            run(CONTROL, "start", "--system-id=random")
        except subprocess.CalledProcessError as error:
            if time.monotonic() > deadline:
                raise RuntimeError(f"Open vSwitch does not start: {error.stderr}") from error
            time.sleep(0.1)
        else:
            started = daemons()
            time.sleep(ENDING_S)
            stays = daemons() == started and not any(map(dumps_core, started.values()))
            if stays and len(started) == len(DAEMONS):
                return
            if time.monotonic() > deadline:
                raise RuntimeError(f"of Open vSwitch only {[*started]} stay")


def stop_open_vswitch() -> None:
    """Stop both daemons, by force if one does not end in time; what starts them again goes first.

    A monitor waits for up to 10 s between two crashes: a database would come in the next run.
    """
    deadline = time.monotonic() + COMMAND_TIMEOUT_S
    while found := monitors():
        if time.monotonic() > deadline:
            raise RuntimeError(f"{', '.join(found)} does not end in {COMMAND_TIMEOUT_S:g} s")
        for pid in found.values():
            with suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
        time.sleep(0.01)
    subprocess.run([CONTROL, "stop"], capture_output=True, check=False, timeout=COMMAND_TIMEOUT_S)
    for pid in daemons().values():
        with suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)


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
    """Return what has become of foreign things, but for bridges."""
    there = {
        f"interface {FOREIGN_LINK[0]}": Path("/sys/class/net", FOREIGN_LINK[0]).exists(),
        f"namespace {FOREIGN_NAMESPACE}": Path("/run/netns", FOREIGN_NAMESPACE).exists(),
        f"folder {FOREIGN_FOLDER}": FOREIGN_FOLDER.exists(),
        "process sleep": any(process.command == ("sleep", mark) for process in processes()),
    }
    return [name for name, still in there.items() if not still]


def things() -> dict[str, set[str]]:
    """Return the names of what a network makes on a machine, and is to take away again."""
    bridges = set()
    if len(daemons()) == len(DAEMONS):
        bridges = set(run("ovs-vsctl", "--timeout=60", "list-br").split())
    return {
        "bridges": bridges,
        "daemons": set(daemons()),
        "interfaces": set(os.listdir("/sys/class/net")),
        "folders": {path.name for path in Path("/run/qmn").glob("*") if path.is_dir()},
        "programs": {
            f"{process.pid} {' '.join(process.command)[:100]}"
            for process in processes()
            if any(word in " ".join(process.command) for word in ("mininet:", "/run/qmn/"))
            or process.command[:1] == ("tcpdump",)
        },
        "namespaces": {
            line.split()[0] for line in run("lsns", "-t", "net", "-n", "-o", "NS").splitlines()
        },
    }


def left(before: dict[str, set[str]]) -> list[str]:
    """Return what is there that was not before, or is no longer, when all has settled."""
    deadline = time.monotonic() + SETTLE_S
    while (now := things()) != before and time.monotonic() < deadline:
        time.sleep(0.1)
    more = [(f"{kind} left", now[kind] - before[kind]) for kind in now]
    less = [(f"{kind} gone", before[kind] - now[kind]) for kind in now]
    return [f"{what}: {', '.join(sorted(names))}" for what, names in more + less if names]
