"""The user namespace of a host, in which its root has powers over what belongs to it alone.

Users and groups are those of this machine, so that root is root to files, too. The host's network
belongs to it from the beginning. The shell comes to that network with the powers of this machine's
root, as Mininet needs them to make links, and enters the user namespace as it is confined.
"""

import ctypes
import os
import select
import subprocess
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from fcntl import F_DUPFD_CLOEXEC, fcntl
from pathlib import Path
from subprocess import PIPE
from typing import TypeVar

from topologies.timeouts import COMMAND_TIMEOUT_S

LIBC = ctypes.CDLL(None, use_errno=True)
CLONE_NEWNS, MS_REC, MS_PRIVATE = 0x20000, 0x4000, 0x40000
LEAST_DESCRIPTOR = 100  # of it in the host's shell: those that the shell opens itself are below
# The owner of a namespace of control groups can mount them, and root owns those of this machine. An
# empty line says that all is done; it stays until its input ends.
FIRST = "echo 0 >/proc/sys/user/max_cgroup_namespaces && echo && read -r _"
MAKE = ["unshare", "--user", "--keep-caps", "--net", "sh", "-c", FIRST]
Result = TypeVar("Result")


class NoUserNamespace(Exception):
    """The kernel makes none; the text says why not."""


class UserNamespace:
    """A new one, and a network that belongs to it; NoUserNamespace where there can be none.

    It stays as long as a shell is in it, or in its network.
    """

    def __init__(self) -> None:
        with subprocess.Popen(
            MAKE, stdin=PIPE, stdout=PIPE, stderr=PIPE, start_new_session=True
        ) as first:
            require_answer(first)
            for ids in ("uid_map", "gid_map"):
                try:
                    Path(f"/proc/{first.pid}/{ids}").write_text(to_themselves(ids))
                except PermissionError as error:
                    raise NoUserNamespace(str(error)) from error
            with open(f"/proc/{first.pid}/ns/user") as user:
                self.descriptor = fcntl(user, F_DUPFD_CLOEXEC, LEAST_DESCRIPTOR)
            self._network = os.open(f"/proc/{first.pid}/ns/net", os.O_RDONLY)

    def start(self, begin: Callable[[], Result]) -> Result:
        """Let a shell be begun in its network, with mounts of its own, and close both.

        A holder of the descriptor can still enter it then.
        """
        try:
            # A thread of its own: one with mounts of its own does not come back to these.
            with ThreadPoolExecutor(1, thread_name_prefix="shell") as thread:
                return thread.submit(self._inside, begin).result()
        finally:
            os.close(self._network)
            os.close(self.descriptor)

    def _inside(self, begin: Callable[[], Result]) -> Result:
        """Begin it where `mnexec -n` would, but in this network."""
        require(LIBC.setns(self._network, 0), "setns to a network namespace")
        require(LIBC.unshare(CLONE_NEWNS), "mounts of its own")
        require(LIBC.mount(b"none", b"/", None, MS_REC | MS_PRIVATE, None), "private mounts")
        require(LIBC.mount(b"sysfs", b"/sys", b"sysfs", 0, None), "mount of /sys")
        return begin()


def without_user_namespaces(hosts: str, why: str) -> str:
    """Return the warning about hosts that have none."""
    return (
        f"{hosts} have no user namespaces ({why}): root there cannot mount, and has powers over "
        "the machine's kernel\n"
    )


def require_answer(first: "subprocess.Popen[bytes]") -> None:
    """Wait until all is done; raise NoUserNamespace, with the words of who cannot, if it is not."""
    assert first.stdout is not None
    assert first.stderr is not None
    poll = select.poll()  # a run of many hosts has more files open than select() takes
    poll.register(first.stdout, select.POLLIN)
    if poll.poll(1e3 * COMMAND_TIMEOUT_S) and os.read(first.stdout.fileno(), 1):
        return
    first.kill()
    error = first.stderr.read().decode(errors="replace").strip()
    raise NoUserNamespace(error or f"no answer in {COMMAND_TIMEOUT_S:g} s")


def to_themselves(ids: str) -> str:
    lines = (line.split() for line in Path("/proc/self", ids).read_text().splitlines())
    return "".join(f"{first} {first} {count}\n" for first, _outside, count in lines)


def require(status: int, what: str) -> None:
    """Raise OSError for what the kernel has refused."""
    if status:
        number = ctypes.get_errno()
        raise OSError(number, f"{what}: {os.strerror(number)}")
