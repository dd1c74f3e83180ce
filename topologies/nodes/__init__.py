"""Mininet node types of a quantum network: each starts its program and ends it again."""

from topologies.nodes.classical_host import ClassicalHost
from topologies.nodes.classical_switch import ClassicalSwitch
from topologies.nodes.controller import QuantumController
from topologies.nodes.dispatcher_host import DispatcherHost
from topologies.nodes.optical_switch import OpticalSwitch
from topologies.nodes.quantum_host import QuantumHost

__all__ = [
    "ClassicalHost",
    "ClassicalSwitch",
    "DispatcherHost",
    "OpticalSwitch",
    "QuantumController",
    "QuantumHost",
]
