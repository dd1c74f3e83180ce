"""A program that has imported the programs of a network once, and forks each of them off.

    python -m topologies.system.processes.fork_server DESCRIPTOR MODULES PADDING

It waits on its end of a socket for requests of the runner (forks.py, beside it), and answers each
with a process id. Its forks become children of the runner, as what that starts itself.
"""

import array
import ctypes
import gc
import hmac
import json
import os
import signal
import socket
import sys
from collections.abc import Callable, Sequence
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NoReturn

from programs.faults import report_fault
from topologies.system.processes import signals

REQUEST_BYTES = 1 << 16
MOST_FILES = 250  # that one message can carry, in Linux
LEAST_NUMBER = 1 << 9  # of descriptors on their way: above those that a program is given
PR_SET_PDEATHSIG = 1
NAMESPACES = "net", "mnt"
COMMAND_BEGIN, COMMAND_END = 45, 46  # fields of /proc/PID/stat after the name and the state
STATE = 1  # number of the first of these fields
CLONE = {"aarch64": 220, "x86_64": 56}  # number of the system call, by machine
NO_CALL = -1  # number of none: the kernel says that it is not implemented
CLONE_PARENT = 1 << 15
LIBC = ctypes.CDLL(None, use_errno=True)
PYTHON = ctypes.PyDLL(None, use_errno=True)  # the same, called without that another thread runs

Main = Callable[[], int | None]


def main() -> int:
    """Import what is to be forked, and fork until the runner ends."""
    gc.disable()  # while it loads what stays
    descriptor, modules, _padding = sys.argv[1:]
    programs = {name: import_module(runnable(name)).main for name in modules.split(",")}
    if threads() != 1:
        print(f"fork server: {threads()} threads after imports; only one can fork", file=sys.stderr)
        return 1
    hmac.digest(b"", b"", "sha256")  # OpenSSL loads what it needs for the first one
    gc.collect()
    gc.freeze()  # so that a collection in a child copies no memory that all share
    gc.enable()
    channel = socket.socket(fileno=int(descriptor))
    print("ready", flush=True)
    while (request := receive(channel)) is not None:
        channel.send(str(fork(programs, *request)).encode())
    return 0


def serve(request: dict[str, Any], files: Sequence[int]) -> NoReturn:
    """Be a fork server in a process that was forked off a runner, to whose code it never returns.

    There, each `with` would clean up the network of the runner.
    """
    status: object = 1
    try:
        signals.reset()
        become(request, files)
        status = main()
    except SystemExit as end:
        status = end.code
    finally:
        if (error := sys.exception()) is not None:
            sys.excepthook(type(error), error, error.__traceback__)
        if isinstance(status, str):
            print(status, file=sys.stderr)
        sys.stdout.flush()
        os._exit(status if isinstance(status, int) else int(status is not None))


def threads() -> int:
    return len(os.listdir("/proc/self/task"))


def runnable(module: str) -> str:
    spec = find_spec(module)
    is_package = spec is not None and spec.submodule_search_locations is not None
    return f"{module}.__main__" if is_package else module


def receive(channel: socket.socket) -> tuple[dict[str, Any], list[int]] | None:
    """Return the next request and the files that came with it; None if the runner has ended."""
    size = array.array("i").itemsize * MOST_FILES
    data, extra, _flags, _address = channel.recvmsg(REQUEST_BYTES, socket.CMSG_SPACE(size))
    files = array.array("i")
    for _level, _kind, sent in extra:
        files.frombytes(sent)
    return (json.loads(data), list(files)) if data else None


def fork(programs: dict[str, Main], request: dict[str, Any], files: Sequence[int]) -> int:
    """Return the process id of a new child of the runner, which runs the program."""
    try:
        pid = fork_sibling()
    except OSError as error:
        sys.exit(report_fault(f"fork server: it cannot fork: {error.strerror}"))
    if not pid:
        become(request, files)
        status = programs[request["module"]]()
        sys.stdout.flush()
        # All is closed: to take the interpreter apart as well would take longer than to end.
        os._exit(status or 0)
    for file in files:
        os.close(file)
    return pid


def fork_sibling() -> int:
    """Do what os.fork does, but give a child to the parent of this process, the runner.

    So that can wait for it, as for what it starts itself (CLONE_PARENT in clone(2)). This process
    must have one thread: the C library's own preparations are passed over, which are for others.
    """
    PYTHON.PyOS_BeforeFork()
    number = CLONE.get(os.uname().machine, NO_CALL)
    pid = PYTHON.syscall(*map(ctypes.c_long, (number, CLONE_PARENT | signal.SIGCHLD, 0, 0, 0, 0)))
    error = ctypes.get_errno()
    if pid:
        PYTHON.PyOS_AfterFork_Parent()
    else:
        PYTHON.PyOS_AfterFork_Child()
    if pid < 0:
        raise OSError(error, os.strerror(error))
    return int(pid)


def become(request: dict[str, Any], files: Sequence[int]) -> None:
    """Make this process what Program.start would have started."""
    keep_files(files, request["descriptors"])
    os.setsid()
    follow_runner(request["runner"])
    enter_namespaces(request["namespace_pid"])
    os.chdir(request["folder"])
    sys.argv = request["command"][2:]
    name_process(request["name"], request["command"])


def follow_runner(runner: int) -> None:
    if LIBC.prctl(PR_SET_PDEATHSIG, signal.SIGTERM):
        raise OSError(ctypes.get_errno(), "prctl(PR_SET_PDEATHSIG)")
    if os.getppid() != runner:
        sys.exit(report_fault(f"process {runner}, the runner, has ended"))


def enter_namespaces(pid: int | None) -> None:
    if pid is None:
        return
    for kind in NAMESPACES:
        try:
            with open(f"/proc/{pid}/ns/{kind}") as namespace:
                if LIBC.setns(namespace.fileno(), 0):
                    raise OSError(ctypes.get_errno(), f"setns to the {kind} namespace of {pid}")
        except FileNotFoundError:
            sys.exit(report_fault(f"process {pid}, the shell of its node, was ended"))


def keep_files(files: Sequence[int], descriptors: Sequence[int]) -> None:
    """Send all output to a log, and keep files by these descriptors; close all others."""
    moved = [os.dup2(file, LEAST_NUMBER + number) for number, file in enumerate(files)]
    nothing = os.open(os.devnull, os.O_RDONLY)
    log, *moved_files = moved
    for source, target in (
        (nothing, 0),
        (log, 1),
        (log, 2),
        *zip(moved_files, descriptors, strict=True),
    ):
        os.dup2(source, target)
    last = 2
    for descriptor in sorted(descriptors):
        os.closerange(last + 1, descriptor)
        last = max(last, descriptor)
    os.closerange(last + 1, LEAST_NUMBER + len(files))


def name_process(name: str, command: Sequence[str]) -> None:
    Path("/proc/self/comm").write_text(name[:15])
    fields = Path("/proc/self/stat").read_text().rpartition(")")[2].split()
    begin, end = int(fields[COMMAND_BEGIN]), int(fields[COMMAND_END])
    text = b"\0".join(map(os.fsencode, command))[: end - begin - 1]
    ctypes.memmove(begin, text.ljust(end - begin, b"\0"), end - begin)


if __name__ == "__main__":
    sys.exit(main())
