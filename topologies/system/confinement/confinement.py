"""The confinement of a host: its shell, and what that starts, see nothing else of the run.

Until it is confined, a host's shell is as Mininet's. Then that becomes the keeper of another:

    keeper (node.shell)      the host's network, this machine's files and processes
     `- shell                the host's network, and processes, /run, /dev/shm, System V IPC and
                             covered files of its own

Our programs of a host are started beside the keeper: those of the host cannot reach them. Where
the kernel allows it the shell is in a user namespace, which the host's network belongs to: root
there can mount, and has no powers over the machine's kernel. Else some of them are given up.
"""

import ctypes
import os
import shlex
import signal
import subprocess
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from mininet.log import warn

from topologies.system.kernel.memory_share import KIB, MIB, MemoryGroup
from topologies.system.kernel.user_namespace import UserNamespace
from topologies.system.processes.owners import Owner, owner
from topologies.system.processes.programs import ROOT, NetworkError, Program
from topologies.system.processes.shells import ShellWatcher
from topologies.timeouts import END_TIMEOUT_S, POLL_S

SHELL = Path(__file__).with_name("confined_shell")
# Without a user namespace. Ways to take covers off: mounting, opening files by their numbers,
# the kernel's memory. And what could take limits off.
GIVEN_UP = "-sys_admin,-dac_read_search,-sys_module,-sys_rawio,-sys_boot,-perfmon,-sys_resource"
APART = [
    "unshare",
    "--pid",
    "--fork",
    "--kill-child",
    "unshare",
    "--mount",
    "--ipc",
    "--mount-proc",
]
READ, WRITTEN = "ro", "rw"  # access to what is shown: words of mount(8)
FIRST_SHOWN = 10  # descriptor by which the shell has the first of what is shown
CLONE_NEWPID = 0x20000000
# A command in the working directory that is its $0, with so much memory (KiB).
LIMITED = 'limit=$1 && shift && cd "$0" && ulimit -d "$limit" && exec "$@"'
# By which root rules the kernel; some are not in all kernels (as Docker's readonlyPaths).
RULED = [Path("/proc/sys"), Path("/sys")]
RULED_IN_SOME = [Path("/proc", name) for name in ("bus", "fs", "irq", "sysrq-trigger")]
# Of its own, or else root of one host could read what is typed on another, or by who runs it.
TERMINALS = "qmn-terminals /dev/pts devpts newinstance,mode=0620,ptmxmode=0666"
# Where programs meet by sockets and files: else a host had the keys of another's WireGuard.
MEETING_PLACES = "qmn-run /run tmpfs mode=755,size=64m", "qmn-shm /dev/shm tmpfs mode=1777"
OWN_NETWORK = [Path("/proc/sys/net"), Path("/sys/devices/virtual/net")]  # all that a host has of it
LIBC = ctypes.CDLL(None, use_errno=True)


class ConfinedNode(ShellWatcher):
    """A node whose shell can be confined, and with it all that people start on the node."""

    shell: "subprocess.Popen[bytes]"
    pid: int
    _confined = 0  # process id of the confined shell
    _memory_bytes = 0  # of each process's data
    _group: MemoryGroup | None = None
    _user: UserNamespace | None = None

    def begin_in_user_namespace(self) -> "subprocess.Popen[bytes]":
        """Begin the shell in the network of a user namespace, which it enters as it is confined.

        Raise NoUserNamespace where there can be none.
        """
        self._user = user = UserNamespace()
        try:
            return user.start(lambda: self._run_shell([], [user.descriptor]))
        except OSError as error:
            raise NetworkError(f"the shell of {self.name} does not start: {error}") from error

    def confine(
        self, shown: Mapping[Path, str], covered: Sequence[Path], table: Path, memory_mib: int
    ) -> None:
        """Let the shell, in which nothing runs, see no folder that is covered but those shown.

        The file of its mounts is written. Programs that people start have `memory_mib`. Raise
        NetworkError, with the kernel's words, where it cannot be.
        """
        self._memory_bytes = memory_mib * MIB
        folders = [path for path in covered if not set(path.parents) & set(covered)]
        table.write_text(fstab(shown, folders, ruled_here()))
        powers = self._user.descriptor if self._user else GIVEN_UP
        shell = [SHELL, self.name, memory_mib * MIB // KIB, powers]
        command = [*APART, *shell, table, *shown, "--", *folders]
        self.write(f"exec {shlex.join(map(str, command))}\n")  # type: ignore[attr-defined]
        self.await_shell(closing(self._user.descriptor if self._user else None))
        (self._confined,) = children(self.shell.pid)
        self._group = MemoryGroup.of_host(self.name, memory_mib)
        self._admit(self._confined)

    def _admit(self, pid: int) -> None:
        if self._group:
            self._group.admit(pid)

    def leave_group(self) -> None:
        """Take away the group of what was started, which has ended; say if it took too much."""
        group, self._group = self._group, None
        if group is None:
            return
        if killed := group.killed:
            mib = self._memory_bytes // MIB
            warn(
                f"{self.name}: {killed} killed, as its programs took more than {mib} MiB together "
                "(memory_mib of the host)\n"
            )
        group.remove()

    @property
    def shell_stopped(self) -> bool:
        process = owner(self._confined) if self._confined else None
        return super().shell_stopped or (process is not None and process.stopped)

    def popen(self, *arguments: Any, **options: Any) -> "subprocess.Popen[Any]":
        if self._confined:
            enter = self._enter(options.get("cwd") or os.curdir)
            options.setdefault("mncmd", ["mnexec", "-d", *enter])
        started = super().popen(*arguments, **options)
        self._admit(started.pid)  # before it has become the command
        return started

    def _enter(self, folder: str | Path) -> list[str]:
        """Return what runs a command where the shell is, in a folder."""
        pid = str(self._confined)
        if self._user is None:
            limits = ["prlimit", f"--data={self._memory_bytes}"]
            given_up = ["setpriv", f"--bounding-set={GIVEN_UP}"]
            return ["nsenter", "--target", pid, "--ipc", "mnexec", "-a", pid, *limits, *given_up]
        # At once: programs that the host sees may be others, and must not run with more powers.
        where = ["--user", "--net", "--mount", "--ipc", "--preserve-credentials"]
        enter = ["nsenter", "--target", pid, *where]
        limited = ["sh", "-c", LIMITED, os.path.abspath(folder), str(self._memory_bytes // KIB)]
        return [*enter, *limited]

    def start_program(self, program: Program, command: Sequence[str]) -> None:
        if not self._confined:
            program.start(command, self.pid)
            return
        with children_beside(self._confined):
            program.start_inside(self._enter(ROOT), command)
        self._admit(program.pid)

    def _popen(self, command: Sequence[str], **options: Any) -> "subprocess.Popen[Any]":
        with children_beside(self._confined):
            return subprocess.Popen(command, **options)

    def hang_up(self) -> None:
        if self._confined and not self.shell_ended:
            programs = [each for pid in descendants(self._confined) if (each := owner(pid))]
            end_by_hanging_up(programs)
        super().hang_up()


def closing(descriptor: int | None) -> str:
    """Return what a shell does first with the descriptor of its user namespace, if it has one."""
    return "" if descriptor is None else f"exec {descriptor}<&-; "


def ruled_here() -> list[Path]:
    """Return by what root rules the kernel of this machine."""
    return [*RULED, *(path for path in RULED_IN_SOME if path.exists())]


def fstab(shown: Mapping[Path, str], covered: Sequence[Path], ruled: Sequence[Path]) -> str:
    """Return what is to be mounted so that folders are covered but those shown, as fstab(5) has it.

    Shown folders have access "ro" or "rw". Folders of our own programs, which see everything, are
    read-only, because they would follow links; so are ruled ones. All by one
    mount(8): there may be a thousand hosts.
    """
    # Sources, or else places, that nobody else writes so: existing ones are not mounted again.
    covers = [f"qmn-cover {escaped(folder)} tmpfs mode=755,X-mount.mkdir" for folder in covered]
    binds = [
        f"/proc/self/fd/{number} {escaped(folder)} none bind,X-mount.mkdir"
        for number, folder in enumerate(shown, FIRST_SHOWN)
    ]
    closes = [
        f"none {escaped(folder)} none remount,bind,{access}"
        for folder, access in (*shown.items(), *((folder, READ) for folder in covered))
    ]
    kernel = [
        line
        for paths, access in ((ruled, READ), (OWN_NETWORK, WRITTEN))
        for path in paths
        for place in [f"{path.parent}/./{path.name}"]
        for line in (f"{path} {place} none bind", f"none {place} none remount,bind,{access}")
    ]
    return "".join(
        f"{line}\n" for line in (*MEETING_PLACES, *covers, *binds, *closes, *kernel, TERMINALS)
    )


def escaped(folder: Path) -> str:
    """Return a path without what separates fields."""
    return str(folder).translate({ord(sign): f"\\{ord(sign):03o}" for sign in "\\ \t\n"})


def end_by_hanging_up(programs: Sequence[Owner]) -> None:
    """Let programs end as their terminal goes; whatever is left then ends with the shell."""
    for program in programs:
        program.signal(signal.SIGHUP)
        program.signal(signal.SIGCONT)
    deadline = time.monotonic() + END_TIMEOUT_S
    while any(program.alive for program in programs) and time.monotonic() < deadline:
        time.sleep(POLL_S)


def children(pid: int) -> list[int]:
    """Return the processes that a process without threads has started, or has taken in."""
    try:
        return [int(word) for word in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]
    except (FileNotFoundError, ProcessLookupError):
        return []  # it has ended


def descendants(pid: int) -> Iterator[int]:
    for child in children(pid):
        yield child
        yield from descendants(child)


@contextmanager
def children_beside(pid: int) -> Iterator[None]:
    """Let what this thread starts meanwhile be born among the processes that a process sees.

    It is nevertheless a child of this process, known here by a process id of here. 0 is nobody.
    """
    if not pid:
        yield
        return
    enter_processes_of(f"/proc/{pid}/ns/pid")
    try:
        yield
    finally:
        enter_processes_of("/proc/thread-self/ns/pid")


def enter_processes_of(namespace: str) -> None:
    """Let this thread's further children be born in a namespace of processes."""
    with open(namespace) as file:
        if LIBC.setns(file.fileno(), CLONE_NEWPID):
            raise OSError(ctypes.get_errno(), f"setns to {namespace}")
