"""The laying of links: a veth pair within a machine, VXLAN between two."""

import itertools
import secrets
from dataclasses import asdict
from typing import Any

from topologies.system.kernel.interfaces import make_pair
from topologies.system.machines.machine import Machine
from topologies.system.machines.tunnel import MOST_IDENTIFIER, TunnelEnd

End = tuple[str, str | None, Any]  # name, hardware address, node

# A number of its own for each link of this process; where it begins tells apart what others lay
# between the same machines.
_identifiers = itertools.count(secrets.randbelow(MOST_IDENTIFIER - (1 << 16)) + 1)


def lay(ends: list[End]) -> None:
    """Make a link of two ends, each at a node wherever that is; raise NetworkError if it cannot be.

    Each end is its name, its hardware address and the node that it is at.
    """
    one, other = (machine_of(end) for end in ends)
    if one is None and other is None:
        make_pair(ends)
    elif one is other and one is not None:
        one.ask("pair", ends=[(name, mac, node.pid_there) for name, mac, node in ends])
    else:
        lay_between(ends, one, other)


def machine_of(end: End) -> Machine | None:
    """Return the machine of an end; None is that of the runner."""
    machine: Machine | None = getattr(end[2], "machine", None)
    return machine


def lay_between(ends: list[End], one: Machine | None, other: Machine | None) -> None:
    identifier = next(_identifiers)
    others = [machine for machine in (one, other) if machine is not None]
    mtu, by = min(machine.mtu for machine in others), others[0].tunnels
    addresses = [
        machine.address if machine else beyond.here if beyond else ""
        for machine, beyond in ((one, other), (other, one))
    ]
    for end, machine, (local, remote) in (
        (ends[0], one, addresses),
        (ends[1], other, addresses[::-1]),
    ):
        name, mac, node = end
        tunnel = TunnelEnd(name, mac, identifier, local, remote, mtu, by)
        if machine is not None:
            machine.tunnel(asdict(tunnel), node.pid_there)
        else:
            tunnel.make(node.pid if node.inNamespace else None)
