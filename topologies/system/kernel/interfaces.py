"""Network interfaces, made and set up by the kernel's own calls, without a program for each step.

veth pairs      rtnetlink(7): one message for both ends, each in its namespace at once; all that go
                together in one
up, addresses   netdevice(7): ioctls on a socket of the namespace
IPv6 off        /proc/sys/net, which is that of the namespace of who looks
"""

import array
import ctypes
import errno
import fcntl
import json
import os
import secrets
import socket
import struct
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from ipaddress import IPv4Interface
from pathlib import Path
from typing import Any, TextIO, TypeVar

from mininet.link import Intf
from mininet.node import Node

from topologies.system.processes.commands import run
from topologies.system.processes.programs import NetworkError
from topologies.timeouts import COMMAND_TIMEOUT_S, INTERFACE_S, POLL_S, STAY_S

LIBC = ctypes.CDLL(None, use_errno=True)
RTM_NEWLINK, RTM_DELLINK, RTM_SETLINK, NLMSG_ERROR = 16, 17, 19, 2
REQUEST = 0x1 | 0x4  # NLM_F_REQUEST, _ACK
CREATE_NEW = REQUEST | 0x200 | 0x400  # NLM_F_EXCL, _CREATE
IFLA_ADDRESS, IFLA_IFNAME, IFLA_LINKINFO, IFLA_NET_NS_PID, IFLA_GROUP = 1, 3, 18, 19, 27
IFLA_INFO_KIND, IFLA_INFO_DATA, VETH_INFO_PEER = 1, 2, 1
MESSAGE, LINK, ATTRIBUTE = struct.Struct("=IHHII"), struct.Struct("=BxHiII"), struct.Struct("=HH")
NAMELESS = LINK.pack(0, 0, 0, 0, 0)
ANSWER_BYTES = 4096
SIOCGIFFLAGS, SIOCSIFFLAGS, SIOCSIFADDR, SIOCSIFNETMASK = 0x8913, 0x8914, 0x8916, 0x891C
SIOCGIFHWADDR, SIOCETHTOOL, SIOCSIFMTU = 0x8927, 0x8946, 0x8922
ETHTOOL_SRXCSUM, ETHTOOL_STXCSUM, ETHTOOL_SGRO = 0x15, 0x17, 0x2C
IFF_UP = 0x1
TUN = "/dev/net/tun"  # by which programs make interfaces
Result = TypeVar("Result")
IPV6, IPV4 = Path("/proc/sys/net/ipv6/conf"), Path("/proc/sys/net/ipv4")
# No probe for lost tails, no slow start after a pause, nothing held back to be sent with more.
STEPPED_TCP = {
    "tcp_early_retrans": 0,
    "tcp_slow_start_after_idle": 0,
    "tcp_congestion_control": "reno",
    "tcp_autocorking": 0,
    "tcp_tso_win_divisor": 255,
    "tcp_synack_retries": 30,  # 5 end after 31 s of the wall, which c0 may hold what they wait for
}
# A question stays until it is answered, and an answer for good.
STEPPED_ARP = {"retrans_time_ms": 100_000, "base_reachable_time_ms": 1_000_000_000}
# Of a route in stepped time: TCP repeats after 100 s of the wall (120 s at most) what nobody has
# acknowledged, and acknowledges at once, as time would leap while it held that back.
PATIENT = "rto_min 100s quickack 1"
# Of OpenFlow: TCP counts segments, and the machine decides how many messages are in one.
WITHOUT_SLOW_START = f"{PATIENT} initcwnd 1000"
# Bytes under way on a connection, at most: of a host as many as a switch in user space can hold,
# for what it loses would come too late; of OpenFlow more than a controller has there at a time.
HOST_WINDOW, OPENFLOW_WINDOW = 1 << 16, 6 << 20
INTERFACES = Path("/sys/class/net")


@contextmanager
def network_of(node: Node) -> Iterator[None]:
    """Be in the network namespace of a node meanwhile, this thread alone.

    Raise NetworkError for a node whose shell somebody has ended.
    """
    with open("/proc/thread-self/ns/net") as home, _namespace_of(node) as there:
        _enter(there.fileno())
        try:
            yield
        finally:
            _enter(home.fileno())


def _namespace_of(node: Node) -> TextIO:
    try:
        return open(f"/proc/{node.pid}/ns/net")
    except FileNotFoundError as error:
        raise NetworkError(f"{node.name} has died: its shell was ended") from error


def _enter(namespace: int) -> None:
    if LIBC.setns(namespace, 0):
        raise OSError(ctypes.get_errno(), "setns to a network namespace")


def within(node: Any, function: Callable[..., Result], *arguments: Any) -> Result:
    """Call a function of this module in the network namespace of a node, wherever that is."""
    machine = getattr(node, "machine", None)
    if machine is not None:
        result: Result = machine.within(node.pid_there, function.__name__, arguments)
        return result
    with network_of(node):
        return function(*arguments)


def switch_ipv6_off(node: Node, *interfaces: str) -> None:
    """Switch IPv6 off at these of a node's interfaces; "default" are those to come."""
    within(node, write_ipv6_off, *interfaces)


def write_ipv6_off(*interfaces: str) -> None:
    """Switch IPv6 off at these interfaces of this thread's namespace."""
    for name in interfaces:
        with suppress(FileNotFoundError):  # of a kernel without IPv6
            (IPV6 / name / "disable_ipv6").write_text("1")


def repeat_nothing(window: int = OPENFLOW_WINDOW) -> None:
    """Have TCP of this thread's namespace neither repeat nor hold anything back by the wall.

    Nor ask again where neighbours of its interfaces are.
    """
    windows = {
        "tcp_wmem": f"4096 {window} {window}",
        "tcp_rmem": f"4096 {OPENFLOW_WINDOW} {OPENFLOW_WINDOW}",
    }
    for name, value in (STEPPED_TCP | windows).items():
        (IPV4 / name).write_text(str(value))
    for interface in (IPV4 / "neigh").iterdir():
        for name, milliseconds in STEPPED_ARP.items():
            (interface / name).write_text(str(milliseconds))


def make_pair(ends: list[tuple[str, str | None, Node]]) -> None:
    """Make a veth pair; each end is its name, its hardware address and the node that it is at.

    Raise NetworkError if that cannot be.
    """
    (name, address, node), peer = ends
    data = _attribute(VETH_INFO_PEER, NAMELESS + _described(*peer))
    kind = _attribute(IFLA_INFO_KIND, b"veth") + _attribute(IFLA_INFO_DATA, data)
    body = NAMELESS + _described(name, address, node)
    body += _attribute(IFLA_LINKINFO, kind)
    with _kernel() as kernel:
        error = _ask(kernel, RTM_NEWLINK, CREATE_NEW, body)
    if error:
        raise NetworkError(f"cannot make the link {name} to {peer[0]}: {os.strerror(error)}")


def all_here() -> set[str]:
    return set(os.listdir(INTERFACES))


def delete(*names: str) -> None:
    """Delete interfaces of ours, those that are there; the peer of each goes with it.

    They become a group of their own, which the kernel deletes at once: for each that goes alone it
    waits some 20 ms, until no processor uses it any more. Raise NetworkError if it fails.
    """
    present = sorted(all_here().intersection(names))
    if not present:
        return
    number = secrets.randbits(31) | 1 << 30  # people's own are small
    with _kernel() as kernel:
        errors = [_put_into(kernel, name, number) for name in present]
        if all(error == errno.ENODEV for error in errors):  # gone meanwhile
            return
        kernel.settimeout(COMMAND_TIMEOUT_S + INTERFACE_S * len(present))
        errors.append(_ask(kernel, RTM_DELLINK, REQUEST, NAMELESS + _group(number)))
        if errors[-1]:
            for name in present:
                _put_into(kernel, name, 0)
    for error in set(errors) - {0, errno.ENODEV}:
        raise NetworkError(f"cannot delete {', '.join(present)}: {os.strerror(error)}")


def _put_into(kernel: socket.socket, name: str, group: int) -> int:
    return _ask(kernel, RTM_SETLINK, REQUEST, NAMELESS + _named(name) + _group(group))


def _group(number: int) -> bytes:
    return _attribute(IFLA_GROUP, struct.pack("=I", number))


def await_end(names: Iterable[str]) -> None:
    """Wait while interfaces of ours go by themselves, then delete those that stay.

    The kernel takes a namespace away with its interfaces and their peers, many at a time, when
    the last process in it has ended.
    """
    left, since = all_here().intersection(names), time.monotonic()
    while left and time.monotonic() < since + STAY_S:
        time.sleep(POLL_S)
        if len(still := left & all_here()) < len(left):
            left, since = still, time.monotonic()
    delete(*left)


def _kernel() -> socket.socket:
    kernel = socket.socket(socket.AF_NETLINK, socket.SOCK_RAW, socket.NETLINK_ROUTE)
    kernel.settimeout(COMMAND_TIMEOUT_S)
    return kernel


def _ask(kernel: socket.socket, kind: int, flags: int, body: bytes) -> int:
    """Send a message to the kernel; return the number of the error that it tells, or 0."""
    kernel.send(MESSAGE.pack(MESSAGE.size + len(body), kind, flags, 1, 0) + body)
    answer = kernel.recv(ANSWER_BYTES)
    if MESSAGE.unpack_from(answer)[1] != NLMSG_ERROR:
        raise NetworkError(f"the kernel gives no answer to message {kind} of rtnetlink")
    (code,) = struct.unpack_from("=i", answer, MESSAGE.size)
    return -int(code)


def _named(name: str) -> bytes:
    return _attribute(IFLA_IFNAME, name.encode() + b"\0")


def _described(name: str, address: str | None, node: Node) -> bytes:
    attributes = _named(name)
    if address is not None:
        attributes += _attribute(IFLA_ADDRESS, bytes.fromhex(address.replace(":", "")))
    if node.inNamespace:
        attributes += _attribute(IFLA_NET_NS_PID, struct.pack("=I", node.pid))
    return attributes


def _attribute(kind: int, value: bytes) -> bytes:
    filled = value.ljust(-(-len(value) // 4) * 4, b"\0")
    return ATTRIBUTE.pack(ATTRIBUTE.size + len(value), kind) + filled


def set_up(name: str) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as kernel:
        answer = fcntl.ioctl(kernel, SIOCGIFFLAGS, _request(name))
        (flags,) = struct.unpack_from("=h", answer, 16)
        fcntl.ioctl(kernel, SIOCSIFFLAGS, _request(name, struct.pack("=h", flags | IFF_UP)))


def set_address(name: str, address: str) -> None:
    """Give an interface of this thread's namespace an IPv4 address, as 10.0.0.1/24."""
    interface = IPv4Interface(address)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as kernel:
        for call, value in ((SIOCSIFADDR, interface.ip), (SIOCSIFNETMASK, interface.netmask)):
            value_there = struct.pack("=Hxx4s", socket.AF_INET, value.packed)
            fcntl.ioctl(kernel, call, _request(name, value_there))


def set_mtu(name: str, mtu: int) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as kernel:
        fcntl.ioctl(kernel, SIOCSIFMTU, _request(name, struct.pack("=i", mtu)))


def interface_with(address: str) -> tuple[str, int]:
    """Return the interface of this machine with an IPv4 address, and what it sends at most."""
    for interface in json.loads(run("ip", "-json", "address", timeout_s=COMMAND_TIMEOUT_S)):
        if address in [each.get("local") for each in interface["addr_info"]]:
            return str(interface["ifname"]), int(interface["mtu"])
    raise NetworkError(f"no interface of this machine has {address}")


def hardware_address(name: str) -> str:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as kernel:
        answer = fcntl.ioctl(kernel, SIOCGIFHWADDR, _request(name))
    return answer[18:24].hex(":")


def finish_checksums(name: str) -> None:
    _switch_off(name, ETHTOOL_STXCSUM, ETHTOOL_SRXCSUM)


def keep_segments(name: str) -> None:
    """Let an interface of this thread's namespace pass on segments of TCP as they came.

    Where the kernel has joined some, Open vSwitch in user space drops them: they are too long.
    """
    _switch_off(name, ETHTOOL_SGRO)


def _switch_off(name: str, *commands: int) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as kernel:
        for command in commands:
            value = array.array("I", [command, 0])
            place, _length = value.buffer_info()
            try:
                fcntl.ioctl(kernel, SIOCETHTOOL, _request(name, struct.pack("=Q", place)))
            except OSError as error:
                if error.errno != errno.EOPNOTSUPP:
                    raise


def _request(name: str, value: bytes = b"") -> bytes:
    return struct.pack("=16s24s", name.encode(), value)  # struct ifreq


class QuickIntf(Intf):
    """An interface that is set up without programs, where Mininet would run ifconfig."""

    def ifconfig(self, *arguments: object) -> str:
        """Do what ifconfig would; return what it would print."""
        match " ".join(map(str, arguments)).split():
            case ["up"]:
                within(self.node, set_up, self.name)
            case [address, "up"] if "/" in address:
                within(self.node, set_address, self.name, address)
                within(self.node, set_up, self.name)
            case _:
                output: str = super().ifconfig(*arguments)
                return output
        return ""

    def updateMAC(self) -> str:  # noqa: N802 (Mininet's name)
        self.mac = within(self.node, hardware_address, self.name)
        return self.mac


def quick(params: dict[str, Any]) -> dict[str, Any]:
    """Return the parameters of a link with such interfaces, unless others are asked for."""
    return {**params, "intf": QuickIntf} if params.get("intf", Intf) is Intf else params
