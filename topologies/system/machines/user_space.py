"""Ends of links between machines by Open vSwitch in user space, for a kernel without VXLAN.

    end of the link ======== qmn-links --- VXLAN ~~~ qmn-under --- the machine's own interface

qmn-under reads that interface beside the kernel, which goes on having it, and takes VXLAN alone. To
other machines it is the kernel's: packets and identifiers are the same.
"""

import fcntl
import json
import os
import socket
import time
from functools import cache
from pathlib import Path
from threading import Lock

from topologies.system.kernel import interfaces
from topologies.system.kernel.interfaces import TUN, finish_checksums
from topologies.system.kernel.packet_sockets import LIBC, PIDFD_GETFD, descriptors
from topologies.system.open_vswitch import openvswitch
from topologies.system.processes.commands import ip, run
from topologies.system.processes.owners import RUNTIME_ROOT
from topologies.system.processes.programs import NetworkError, Program
from topologies.timeouts import COMMAND_TIMEOUT_S, NEIGHBOUR_TIMEOUT_S, POLL_S

PORT = 4789  # of VXLAN (RFC 7348)
BRIDGES = UNDER, LINKS = "qmn-under", "qmn-links"
OUTSIDE = 1  # port of the machine's interface at the former
TUNSETPERSIST = 0x400454CB  # of Linux's if_tun.h
DISCARD = 9  # a port of UDP at which nobody need listen
MAY_NOT = (
    "tunnels of Open vSwitch need the right to take files of its daemon (pidfd_getfd, Linux 5.6), "
    "which containers do not have unless they are given CAP_SYS_PTRACE: use --tunnels kernel, or a "
    "worker outside a container"
)

_laying = Lock()  # links are laid by several threads


def make(name: str, mtu: int, identifier: int, ends: tuple[str, str], for_host: bool) -> None:
    """Make the end of a link, here; raise NetworkError if it cannot be.

    `ends` are the addresses of this machine and the other one. That of a host can be moved to its
    namespace, and ends with Open vSwitch; any other can be a port of another bridge.
    """
    local, remote = ends
    with _laying:
        _lay_under(local)
        _lead_to(remote)
    inner, tunnel = name if for_host else f"link{identifier}", f"vxlan{identifier}"
    command = ["add-port", LINKS, inner]
    if for_host:
        command += ["--", "set", "interface", name, "type=internal", f"mtu_request={mtu}"]
    else:
        ip(
            [
                f"link add {name} mtu {mtu} type veth peer name {inner} mtu {mtu}",
                f"link set {inner} up",
            ]
        )
        finish_checksums(name)
    options = ["type=vxlan", f"options:remote_ip={remote}", f"options:key={identifier}"]
    command += ["--", "add-port", LINKS, tunnel, "--", "set", "interface", tunnel, *options]
    openvswitch.vsctl(*command)
    if for_host:
        _let_interfaces_end_with(openvswitch.switch_daemon_pid())
    for one, other in ((inner, tunnel), (tunnel, inner)):
        _add_flow(LINKS, f"in_port={one},actions=output:{other}")


def remove() -> None:
    _lay_under.cache_clear()
    _lead_to.cache_clear()
    openvswitch.delete(*BRIDGES)
    interfaces.delete(*BRIDGES)  # they stay when its daemon is killed


def _daemon(name: str) -> Program:
    RUNTIME_ROOT.mkdir(mode=0o755, parents=True, exist_ok=True)
    return Program(name, RUNTIME_ROOT / f"{name}.log")


@cache
def _lay_under(local: str) -> None:
    """Make the bridges; `local` is the address of this machine that packets come to."""
    if not openvswitch.running():
        openvswitch.start(_daemon)
    nic, _mtu = interfaces.interface_with(local)
    made = []
    for bridge in BRIDGES:
        settings = ["datapath_type=netdev", "fail_mode=secure"]
        made += ["--", "add-br", bridge, "--", "set", "bridge", bridge, *settings]
    mac = Path("/sys/class/net", nic, "address").read_text().strip()
    made += ["--", "set", "bridge", UNDER, f'other_config:hwaddr="{mac}"']
    made += ["--", "add-port", UNDER, nic]
    made += ["--", "set", "interface", nic, f"ofport_request={OUTSIDE}"]
    openvswitch.vsctl(*made[1:])
    openvswitch.require_made(BRIDGES)
    comes = f"in_port={OUTSIDE},udp,nw_dst={local},tp_dst={PORT}"
    _add_flow(UNDER, f"{comes},actions=LOCAL")
    _add_flow(UNDER, f"in_port=LOCAL,actions=output:{OUTSIDE}")
    # By its address Open vSwitch knows what is for its tunnels; the kernel sends nothing there.
    ip([f"address add {local}/0 dev {UNDER} noprefixroute", f"link set {UNDER} arp off up"])


@cache
def _lead_to(remote: str) -> None:
    for command in (
        ("ovs/route/add", f"{remote}/32", UNDER),
        ("tnl/arp/set", UNDER, remote, _next_hop(remote)),
    ):
        run("ovs-appctl", "-t", openvswitch.SWITCH_DAEMON, *command, timeout_s=COMMAND_TIMEOUT_S)


def _next_hop(remote: str) -> str:
    """Return the hardware address that packets to a machine go to."""
    (way,) = json.loads(run("ip", "-json", "route", "get", remote, timeout_s=COMMAND_TIMEOUT_S))
    hop, deadline = way.get("gateway", remote), time.monotonic() + NEIGHBOUR_TIMEOUT_S
    while time.monotonic() < deadline:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as asking:
            asking.sendto(b"", (remote, DISCARD))  # the kernel asks for it then
        command = "ip", "-json", "neigh", "show", hop, "dev", way["dev"]
        for neighbour in json.loads(run(*command, timeout_s=COMMAND_TIMEOUT_S) or "[]"):
            if "lladdr" in neighbour:
                return str(neighbour["lladdr"])
        time.sleep(POLL_S)
    raise NetworkError(f"no neighbour answers for {hop} in {NEIGHBOUR_TIMEOUT_S:g} s")


def _let_interfaces_end_with(pid: int) -> None:
    """Let what a process has made by TUN end with it, even where it is killed."""
    try:
        files = descriptors(pid, [TUN])
    except PermissionError as error:
        raise NetworkError(MAY_NOT) from error
    process = os.pidfd_open(pid)
    try:
        for file in files:
            descriptor = LIBC.syscall(PIDFD_GETFD, process, file, 0)
            if descriptor < 0:
                raise NetworkError(MAY_NOT)
            fcntl.ioctl(descriptor, TUNSETPERSIST, 0)
            os.close(descriptor)
    finally:
        os.close(process)


def _add_flow(bridge: str, flow: str) -> None:
    run("ovs-ofctl", "--names", "add-flow", bridge, flow, timeout_s=COMMAND_TIMEOUT_S)
