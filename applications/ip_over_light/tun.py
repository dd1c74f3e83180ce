"""The interface q0: a TUN device of Linux, from which IP packets are read and to which written."""

import fcntl
import os
import struct
import subprocess
from collections.abc import Sequence
from pathlib import Path

from applications.timeouts import COMMAND_TIMEOUT_S

DEVICE = Path("/dev/net/tun")
TUNSETIFF = 0x400454CA  # linux/if_tun.h
IFF_TUN, IFF_NO_PI = 0x0001, 0x1000
REQUEST = struct.Struct("16sH22x")  # struct ifreq: name and flags
IPV6 = Path("/proc/sys/net/ipv6/conf")
# Of an interface without an address of IPv6, and of one that has one: what the kernel says by
# itself would spend pairs.
OFF = {"disable_ipv6": "1"}
QUIET = {
    "disable_ipv6": "0",
    "addr_gen_mode": "1",  # no link-local address
    "accept_ra": "0",
    "router_solicitations": "0",
    "accept_dad": "0",
}


class TunError(Exception):
    """The interface cannot be made; the text says what to do."""


class Tun:
    """An interface of its own for IP packets; it goes when it is closed."""

    def __init__(self, name: str, addresses: Sequence[str], mtu: int) -> None:
        """Make it, in the network namespace of this process; raise TunError if it cannot be.

        Addresses are of either version, with prefix lengths.
        """
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
        sixth = any(":" in address for address in addresses)
        if (IPV6 / name).exists():
            for setting, value in (QUIET if sixth else OFF).items():
                (IPV6 / name / setting).write_text(value)
        elif sixth:
            raise TunError("this kernel has no IPv6: take an MTU below 1280, which has none either")
        _ip("link", "set", name, "mtu", str(mtu))
        for address in addresses:
            _ip("address", "add", address, "dev", name)
        _ip("link", "set", name, "up")

    def read(self) -> bytes:
        return os.read(self._file, self._most)

    def write(self, packet: bytes) -> None:
        os.write(self._file, packet)

    def close(self) -> None:
        os.close(self._file)


def _ip(*words: str) -> None:
    command = ["ip", *words]
    done = subprocess.run(
        command, capture_output=True, text=True, timeout=COMMAND_TIMEOUT_S, check=False
    )
    if done.returncode:
        raise TunError(f"{' '.join(command)}: {done.stderr.strip()}")
