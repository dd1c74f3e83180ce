"""The placing of hosts on machines, in a topology that is not built yet."""

from collections.abc import Mapping

from mininet.topo import Topo

from topologies.nodes import ClassicalHost, DispatcherHost
from topologies.system.machines.machine import Machine
from topologies.system.machines.node import elsewhere
from topologies.system.processes.programs import NetworkError


def place(topo: Topo, places: Mapping[str, Machine]) -> None:
    """Let hosts be made on their machines; raise NetworkError for what must stay on the first."""
    for name, machine in places.items():
        if name not in topo.hosts():
            raise NetworkError(
                f"{name} is not a host of this network: place {', '.join(topo.hosts())}"
            )
        info = topo.nodeInfo(name)
        kind = info.get("cls")
        if not isinstance(kind, type) or not issubclass(kind, ClassicalHost):
            raise NetworkError(f"{name} is not a host of ours: it is on the first machine")
        if issubclass(kind, DispatcherHost):
            raise NetworkError(f"{name} has the dispatcher, which is on the first machine")
        info["cls"] = elsewhere(kind, machine)
