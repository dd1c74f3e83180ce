"""The packet sockets of Open vSwitch in user space, one for each port, while bridges are deleted.

The last one to close such a socket waits until no processor can still see it (packet_release in
Linux's net/packet/af_packet.c): some 20 ms. The kernel closes those of a process one after the
other, also where it ends a namespace. So this process has them as well meanwhile, and closes all
beside each other, which then share their waits: a tree of 64 hosts ends in .13 s instead of 3.6 s.
"""

import ctypes
import os
from collections.abc import Container, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from pathlib import Path

PIDFD_GETFD = 438  # number of the system call, on all of Linux's architectures
AT_ONCE = 64
INODE = 8  # field of a line of /proc/PID/net/packet
LIBC = ctypes.CDLL(None, use_errno=True)


@contextmanager
def held(pid: int) -> Iterator[None]:
    """Hold the packet sockets that a process has, and close them at the end.

    Where this process may not, or the kernel is older than Linux 5.6, it holds none.
    """
    sockets = taken(pid)
    try:
        yield
    finally:
        close(sockets)


def taken(pid: int) -> list[int]:
    try:
        process = os.pidfd_open(pid)
    except OSError:
        return []
    try:
        mine = [LIBC.syscall(PIDFD_GETFD, process, number, 0) for number in packet_sockets(pid)]
    finally:
        os.close(process)
    return [number for number in mine if number >= 0]


def packet_sockets(pid: int) -> list[int]:
    """Return the descriptors by which a process has packet sockets of its network, none if gone."""
    with suppress(OSError):
        lines = Path(f"/proc/{pid}/net/packet").read_text().splitlines()[1:]
        return descriptors(pid, {f"socket:[{line.split()[INODE]}]" for line in lines})
    return []


def descriptors(pid: int, names: Container[str]) -> list[int]:
    """Return the descriptors by which a process has files of these names; OSError if not to see."""
    numbers = []
    for file in os.scandir(f"/proc/{pid}/fd"):
        with suppress(FileNotFoundError):  # it has been closed
            if os.readlink(file.path) in names:
                numbers.append(int(file.name))
    return numbers


def close(descriptors: Sequence[int]) -> None:
    if descriptors:
        with ThreadPoolExecutor(AT_ONCE, thread_name_prefix="close") as pool:
            list(pool.map(os.close, descriptors))
