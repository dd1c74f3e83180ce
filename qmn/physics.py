"""Public API of the physical layer: devices and fibres with their ranges, and models of noise."""

from dispatcher.approximations import approximation
from dispatcher.devices.hardware import Moment
from dispatcher.fiber.noise import Effect, NoiseModel, Passage
from topologies.catalogue.node_kinds import NodeKind
from wire.parameters.fiber import FiberOptics
from wire.parameters.physics import (
    BadParameter,
    BellAnalyser,
    Detectors,
    Device,
    Emitter,
    Gates,
    Memory,
    PairSource,
    Sensor,
)
from wire.parameters.switch import QuantumSwitch

__all__ = [
    "BadParameter",
    "BellAnalyser",
    "Detectors",
    "Device",
    "Effect",
    "Emitter",
    "FiberOptics",
    "Gates",
    "Memory",
    "Moment",
    "NodeKind",
    "NoiseModel",
    "PairSource",
    "Passage",
    "QuantumSwitch",
    "Sensor",
    "approximation",
]
