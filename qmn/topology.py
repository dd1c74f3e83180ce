"""Public API of topologies: nodes, fibres and their parts, for a file of `--custom` or a script."""

from topologies.links.fiber import FiberLink
from topologies.nodes import (
    ClassicalHost,
    ClassicalSwitch,
    OpticalSwitch,
    QuantumHost,
)
from topologies.quantum_topo import QuantumTopo
from wire.parameters.physics import BellAnalyser, Detectors, Memory, PairSource

__all__ = [
    "BellAnalyser",
    "ClassicalHost",
    "ClassicalSwitch",
    "Detectors",
    "FiberLink",
    "Memory",
    "OpticalSwitch",
    "PairSource",
    "QuantumHost",
    "QuantumTopo",
]
