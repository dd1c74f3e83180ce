"""The interface q0: a TUN device of Linux, from which IP packets are read and to which written."""

import fcntl
import os
import struct
import subprocess
from pathlib import Path

from hosts.timeouts import COMMAND_TIMEOUT_S

DEVICE = Path("/dev/net/tun")
TUNSETIFF = 0x400454CA  # linux/if_tun.h
IFF_TUN, IFF_NO_PI = 0x0001, 0x1000
REQUEST = struct.Struct("16sH22x")  # struct ifreq: name and flags
IPV6 = "/proc/sys/net/ipv6/conf/{}/disable_ipv6"


class TunError(Exception):
    """The interface cannot be made; the text says what to do."""


class Tun:
    """An interface of its own for IP packets; it goes when it is closed."""

    def __init__(self, name: str, address: str, prefix_length: int, mtu: int) -> None:
        """Make it, in the network namespace of this process; raise TunError if it cannot be."""
        try:
            self._file = os.open(DEVICE, os.O_RDWR)
        except OSError as error:
            raise TunError(
                f"cannot open {DEVICE} ({error.strerror}): load the kernel module tun, or give "
                f"the container --device {DEVICE}"
            ) from error
        self._most = mtu
        try:
            request = REQUEST.pack(name.encode(), IFF_TUN | IFF_NO_PI)
            fcntl.ioctl(self._file, TUNSETIFF, request)
        except OSError as error:
            os.close(self._file)
            raise TunError(f"cannot make the interface {name}: {error.strerror}") from error
        ipv6 = Path(IPV6.format(name))
        if ipv6.exists():  # its neighbour discovery would spend pairs
            ipv6.write_text("1")
        _ip("address", "add", f"{address}/{prefix_length}", "dev", name)
        _ip("link", "set", name, "mtu", str(mtu), "up")

    def read(self) -> bytes:
        """Wait for the next packet that this host sends."""
        return os.read(self._file, self._most)

    def write(self, packet: bytes) -> None:
        """Let this host receive a packet."""
        os.write(self._file, packet)

    def close(self) -> None:
        """Take the interface away."""
        os.close(self._file)


def _ip(*words: str) -> None:
    command = ["ip", "-4", *words]
    done = subprocess.run(
        command, capture_output=True, text=True, timeout=COMMAND_TIMEOUT_S, check=False
    )
    if done.returncode:
        raise TunError(f"{' '.join(command)}: {done.stderr.strip()}")
