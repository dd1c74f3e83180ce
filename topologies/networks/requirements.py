"""Checks before a network starts: root, open files, free names and certificates."""

import os
import resource

from mininet.topo import Topo

from topologies.nodes import DispatcherHost, OpticalSwitch, QuantumHost
from topologies.nodes.tls import OPEN_VSWITCH, OPERATOR
from topologies.system.kernel import interfaces
from topologies.system.namespaces import are_own
from topologies.system.open_vswitch import openvswitch
from topologies.system.processes.programs import NetworkError
from topologies.system.runs.runtime import Runtime

LEAST_FILES, MOST_FILES = 1_024, 65_536
CERTIFIED = QuantumHost, DispatcherHost, OpticalSwitch
FIRST_CONTROLLER = "c0"  # Mininet's name of it


def allow_files() -> None:
    """Let this process have files open for the terminals of a thousand nodes, if it may.

    Raise NetworkError if it may not even have those of a small network.
    """
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    most = MOST_FILES if hard == resource.RLIM_INFINITY else min(hard, MOST_FILES)
    if most < LEAST_FILES:
        raise NetworkError(
            f"this process may open {most} files, a network needs {LEAST_FILES}: raise the hard "
            f"limit (`ulimit -Hn {LEAST_FILES}`)"
        )
    if soft < most:
        resource.setrlimit(resource.RLIMIT_NOFILE, (most, hard))


def require_root() -> None:
    """Raise NetworkError for an ordinary user."""
    if os.geteuid():
        raise NetworkError("network namespaces and Open vSwitch need root: run it with sudo")


def require_free(topo: Topo) -> None:
    """Raise NetworkError, before a run makes a folder, for what it would be refused for at once.

    An ordinary user, or bridges of this machine with the names of its switches.
    """
    require_root()
    allow_files()
    refuse_bridges(topo)


def delete_interfaces_of(switches: list[str]) -> None:
    """Delete the interfaces that switches have, and what the daemon has left that was killed."""
    names = [name for switch in switches for name in interfaces_of(switch)]
    interfaces.delete(*names, *([openvswitch.DATAPATH_INTERFACE] if are_own() else []))


def interfaces_of(switch: str) -> list[str]:
    """Return the interfaces on this machine that a switch of this name would have."""
    names = sorted(path.name for path in interfaces.INTERFACES.iterdir())
    return [name for name in names if name == switch or name.startswith(f"{switch}-eth")]


def require_certificates(topo: Topo, network: Runtime) -> None:
    """Raise NetworkError if certificates are given and one of a program is missing or wrong."""
    if not network.settings.tls_from:
        return
    kinds = {name: topo.nodeInfo(name).get("cls") for name in (*topo.hosts(), *topo.switches())}
    names = [
        name
        for name, kind in kinds.items()
        if isinstance(kind, type) and issubclass(kind, CERTIFIED)
    ]
    for name in (
        *names,
        OPEN_VSWITCH,
        FIRST_CONTROLLER,
        *([OPERATOR] if network.settings.gnmi else []),
    ):
        network.authority().check(name)


def refuse_bridges(topo: Topo) -> None:
    """Raise NetworkError for a switch whose name is that of a bridge of this machine."""
    taken = [] if are_own() else sorted(set(openvswitch.bridges()) & set(topo.switches()))
    if taken:
        raise NetworkError(
            f"bridge {taken[0]} exists already and is not ours; "
            f"remove it with `ovs-vsctl del-br {taken[0]}` or rename it"
        )


def refuse_taken_names(topo: Topo) -> None:
    """Raise NetworkError before Mininet would delete somebody else's bridge."""
    refuse_bridges(topo)
    for interface in [name for switch in topo.switches() for name in interfaces_of(switch)]:
        raise NetworkError(
            f"interface {interface} exists already and is not ours; "
            f"remove it with `ip link del {interface}` or rename it"
        )
