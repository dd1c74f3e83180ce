"""The namespaces of a run: its own network, processes, mounts, /run and Open vSwitch.

    keeper          on the machine: passes signals on, and ends with what it keeps
     `- first       process 1 of the namespaces: waits for processes without a parent
         `- run     builds the network

When one of them ends, the kernel ends all below it and frees what they held.
"""

import ctypes
import fcntl
import json
import os
import signal
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import IO, NoReturn, TypeVar

from topologies.system.processes import owners
from topologies.system.processes.commands import WITH_THIS_PROCESS
from topologies.system.processes.owners import RUNTIME_ROOT
from topologies.system.processes.programs import ROOT, NetworkError
from topologies.system.processes.signals import Signals

T = TypeVar("T")

OWN_NAMESPACES = ROOT / "topologies" / "own_namespaces"
MACHINE_NETWORK = RUNTIME_ROOT / "machine-network"  # a file of the machine's network, inside
OWN_NETWORK = RUNTIME_ROOT / "own-network"  # exists when the network is own, too
ENTRIES = "*.run"  # on the machine: one for each run in namespaces of its own
FORWARDED = {*Signals.NUMBERS, *Signals.OTHERS}
KILLED = 128 + signal.SIGKILL
SI_KERNEL = 0x80  # asm-generic/siginfo.h: of a terminal, which reaches all its processes by itself
PR_SET_PDEATHSIG = 1
CLONE_NEWNS, CLONE_NEWIPC, CLONE_NEWPID, CLONE_NEWNET = 0x20000, 0x8000000, 0x20000000, 0x40000000
MS_REC, MS_PRIVATE, MNT_DETACH = 0x4000, 0x40000, 2
JOINED = "ipc", "net", "mnt"
LIBC = ctypes.CDLL(None, use_errno=True)

_keeper: str | None = None  # of this run, for those who know its process ids


@dataclass(frozen=True)
class RunningRun:
    keeper: int  # process id
    first: int  # process id on this machine of process 1
    command: str

    def __str__(self) -> str:
        return f"{self.keeper} ({self.command})"


def are_own() -> bool:
    return MACHINE_NETWORK.exists()


def with_own_network() -> bool:
    """Return whether the network is own, too, not the machine's (--network-of-machine)."""
    return OWN_NETWORK.exists()


def in_own_namespaces(command: Sequence[str]) -> list[str]:
    """Return what runs a command in new namespaces, as root; all ends with the calling thread."""
    return [*WITH_THIS_PROCESS, str(OWN_NAMESPACES), *command]


def enter_new(command: Sequence[str], own_network: bool = True) -> int | None:
    """Go on in new namespaces, as a child of this process: return None there.

    In this process return the exit status of the child. Raise NetworkError if the kernel refuses.
    """
    global _keeper
    _keeper = _this_process()
    file = RUNTIME_ROOT / f"{os.getpid()}.run"
    entry = _begun(file)
    machine = os.open("/proc/self/ns/net", os.O_RDONLY)
    ready, first_is_ready = os.pipe()
    _flush()
    _require(LIBC.unshare(CLONE_NEWPID), "a new namespace of processes")
    first = _fork()
    if not first:
        os.close(ready)
        _prepare(machine, own_network)
        os.write(first_is_ready, b"\n")
        os.close(first_is_ready)
        _go_on_as_child()
        return None
    os.close(first_is_ready)
    os.close(machine)
    if os.read(ready, 1):
        run = RunningRun(os.getpid(), first, " ".join(command))
        entry.write(json.dumps(asdict(run)))
        entry.flush()
    os.close(ready)
    status = keep(first)
    file.unlink(missing_ok=True)
    entry.close()
    if status == KILLED:
        print("qmn: the run was killed (SIGKILL); the kernel ended what was left", file=sys.stderr)
    return status


def enter(run: RunningRun) -> int | None:
    """Go on among the processes of a run, as `enter_new`; raise NetworkError if it has ended."""
    _join(run, ("pid", *JOINED))
    child = _fork()
    if not child:
        return None
    status = keep(child)
    if status == KILLED:
        print(f"qmn: run {run} has ended, and this command with it", file=sys.stderr)
    return status


def visit(run: RunningRun) -> None:
    """Go on in the network and files of a run, beside its processes: it may end before this one."""
    _join(run, JOINED)
    _require(LIBC.unshare(CLONE_NEWNS), "mounts of its own")
    _require(LIBC.mount(b"none", b"/", None, MS_REC | MS_PRIVATE, None), "private mounts")
    _require(LIBC.umount2(b"/proc", MNT_DETACH), "to see this machine's processes")


def _join(run: RunningRun, kinds: Sequence[str]) -> None:
    folder = os.getcwd()
    try:
        files = [os.open(f"/proc/{run.first}/ns/{kind}", os.O_RDONLY) for kind in kinds]
    except FileNotFoundError as error:
        raise NetworkError(f"run {run} has ended") from error
    _flush()
    for file, kind in zip(files, kinds, strict=True):
        _require(LIBC.setns(file, 0), f"the {kind} namespace of run {run}")
        os.close(file)
    os.chdir(folder)


def keeper() -> str:
    """Return who keeps this run, as processes outside it can know: namespace, then owner."""
    return _keeper or _this_process()


def keeper_is_gone(words: str) -> bool:
    namespace, _, owner = words.partition(".")
    return namespace == owners.namespace() and owners.gone(owner)


def _this_process() -> str:
    return f"{owners.namespace()}.{owners.this_process()}"


def running() -> list[RunningRun]:
    """Return the runs in namespaces of their own; remove the entries of runs that are gone."""
    return list(_running())


def _running() -> Iterator[RunningRun]:
    for file in sorted(RUNTIME_ROOT.glob(ENTRIES)):
        try:
            with file.open() as entry:
                if _lock(entry):
                    file.unlink(missing_ok=True)
                    continue
                text = entry.read()
        except PermissionError as error:
            raise NetworkError(f"the runs in {RUNTIME_ROOT} belong to root: use sudo") from error
        except FileNotFoundError:  # it has just ended
            continue
        if text:  # else it is just beginning
            yield RunningRun(**json.loads(text))


def machine_listener(host: str, port: int) -> socket.socket:
    """Return a listening TCP socket in the machine's network; raise OSError if it cannot be."""
    return in_machine_network(lambda: socket.create_server((host, port)))


def in_machine_network(act: Callable[[], T]) -> T:
    if not are_own():
        return act()
    with ThreadPoolExecutor(1, thread_name_prefix="machine") as thread:
        return thread.submit(_outside, act).result()


def _outside(act: Callable[[], T]) -> T:
    """Act there; the calling thread stays in that network."""
    with MACHINE_NETWORK.open() as network:
        _require(LIBC.setns(network.fileno(), CLONE_NEWNET), "the machine's network")
    return act()


def _begun(file: Path) -> IO[str]:
    while True:
        try:
            RUNTIME_ROOT.mkdir(mode=0o755, parents=True, exist_ok=True)
            entry = os.fdopen(os.open(file, os.O_RDWR | os.O_CREAT | os.O_TRUNC, 0o600), "w")
        except OSError as error:
            raise NetworkError(f"{file} cannot be written: {error.strerror}") from error
        fcntl.flock(entry, fcntl.LOCK_EX)
        if os.fstat(entry.fileno()).st_nlink:
            return entry
        entry.close()  # another process removed it as a leftover before it was locked


def _lock(entry: IO[str]) -> bool:
    """Lock an entry, until this process and its children close it; return False if another has."""
    try:
        fcntl.flock(entry, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


def _prepare(machine: int, own_network: bool) -> None:
    kinds = CLONE_NEWNS | CLONE_NEWIPC | (CLONE_NEWNET if own_network else 0)
    _require(LIBC.prctl(PR_SET_PDEATHSIG, signal.SIGKILL), "prctl(PR_SET_PDEATHSIG)")
    try:
        _require(LIBC.unshare(kinds), "new namespaces")
        command = [str(OWN_NAMESPACES), "--prepare", f"/proc/self/fd/{machine}"]
        subprocess.run(command, pass_fds=[machine], check=True)
    except (NetworkError, subprocess.CalledProcessError) as error:
        print(f"qmn: {error}", file=sys.stderr)
        _end(1)
    os.close(machine)


def _go_on_as_child() -> None:
    """Return in a child; as the first process wait for it, and end with its status."""
    if child := _fork():
        _end(keep(child))


def _fork() -> int:
    """Fork; the parent has the signals blocked that `keep` waits for."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {*FORWARDED, signal.SIGCHLD})
    if not (child := os.fork()):
        signal.pthread_sigmask(signal.SIG_SETMASK, before - {*FORWARDED, signal.SIGCHLD})
    return child


def keep(child: int) -> int:
    """Return the exit status of a child; pass on signals that were sent to this process alone."""
    while True:
        received = signal.sigwaitinfo({*FORWARDED, signal.SIGCHLD})
        if received.si_signo == signal.SIGCHLD:
            if (status := _reaped(child)) is not None:
                return status
        elif received.si_code != SI_KERNEL or received.si_signo == signal.SIGHUP:
            os.kill(child, received.si_signo)  # a closed terminal tells the session's leader alone


def _reaped(child: int) -> int | None:
    """Wait for all children that have ended; return the status of this one if it has."""
    status = None
    while True:
        try:
            pid, waited = os.waitpid(-1, os.WNOHANG)
        except ChildProcessError:
            return status
        if not pid:
            return status
        if pid == child:
            code = os.waitstatus_to_exitcode(waited)
            status = code if code >= 0 else 128 - code


def _flush() -> None:
    sys.stdout.flush()
    sys.stderr.flush()


def _end(status: int) -> NoReturn:
    _flush()
    os._exit(status)


def _require(result: int, what: str) -> None:
    if result:
        reason = os.strerror(ctypes.get_errno())
        raise NetworkError(f"the kernel refuses {what}: {reason}; a run needs CAP_SYS_ADMIN")
