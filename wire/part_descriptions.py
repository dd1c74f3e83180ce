"""The kind and parameters of the part behind an inner port, as a property of its description.

    type ffff (2), length (2), experimenter (4), its type 1 (4)
    kind (2), input or half from 1, or 0 (2), number of the part (4)
    parameters of this kind

Properties are padded to a multiple of 8 bytes. Probabilities are in millionths.
"""

import struct
from dataclasses import astuple, dataclass
from typing import ClassVar, Self

from wire.optical import EXPERIMENTER
from wire.parameters.physics import ANALYSERS, BEAM_SPLITTER, SCHEMES, Device
from wire.parameters.switch import InnerPort, Kind

HEAD = struct.Struct("!HHIIHHI")
OFPPDPT_EXPERIMENTER = 0xFFFF
INNER_PORT = 1  # exp_type
NEVER_NS = (1 << 64) - 1
STATION = 5  # an analyser of linear optics, which heralds pairs of memories that emit, too
STATISTICS = ("none", "single", "poisson", "thermal")


@dataclass(frozen=True)
class AnalyserParameters:
    """Of a Bell analyser, and of a station."""

    FIELDS: ClassVar[struct.Struct] = struct.Struct("!5IQ")

    optics: int  # of ANALYSERS, from 1
    efficiency: int  # of a detector
    visibility: int
    gate_depolarizing: int  # by a gate on two qubits
    detector_gate_ps: int
    dark_counts: int  # of a detector, in 1000 s

    @classmethod
    def of(cls, parts: Device) -> Self:
        detectors, analyser = parts.detectors, parts.analyser
        return cls(
            1 + ANALYSERS.index(analyser.kind),
            _millionths(detectors.efficiency),
            _millionths(analyser.visibility),
            _millionths(parts.gates.two_qubit_depolarizing),
            round(detectors.gate_s * 1e12),
            round(detectors.dark_count_hz * 1e3),
        )


@dataclass(frozen=True)
class MemoryParameters:
    """Of a memory; times in ns."""

    FIELDS: ClassVar[struct.Struct] = struct.Struct("!IIQQQ")

    modes: int
    efficiency: int
    t1_ns: int
    t2_ns: int
    cutoff_ns: int

    @classmethod
    def of(cls, parts: Device) -> Self:
        memory = parts.memory
        times = (_nanoseconds(each) for each in (memory.t1_s, memory.t2_s, memory.cutoff_s))
        return cls(memory.capacity, _millionths(memory.efficiency), *times)


@dataclass(frozen=True)
class SourceParameters:
    """Of a source of pairs."""

    FIELDS: ClassVar[struct.Struct] = struct.Struct("!6IQ")

    statistics: int  # of STATISTICS
    mean_pairs: int  # a pulse, in millionths
    phi_plus: int  # how likely a pair is in this state
    psi_plus: int
    phi_minus: int
    psi_minus: int
    max_rate_hz: int

    @classmethod
    def of(cls, parts: Device) -> Self:
        source = parts.source
        mean = 1.0 if source.statistics == "single" else source.mean_pairs
        statistics, millionths = STATISTICS.index(source.statistics), _millionths(mean)
        phi, psi, turned_phi, turned_psi = map(_millionths, source.bell_probabilities())
        rate_hz = round(source.max_rate_hz)
        return cls(statistics, millionths, phi, psi, turned_phi, turned_psi, rate_hz)


@dataclass(frozen=True)
class EmitterParameters:
    """Of the port by which a memory emits."""

    FIELDS: ClassVar[struct.Struct] = struct.Struct("!5IQ")

    scheme: int  # of SCHEMES
    modes: int  # qubits that attempt at the same time
    efficiency: int
    bright_state: int
    fidelity: int
    preparation_ns: int

    @classmethod
    def of(cls, parts: Device) -> Self:
        emitter = parts.emitter
        return cls(
            SCHEMES.index(emitter.scheme),
            emitter.modes,
            _millionths(emitter.efficiency),
            _millionths(emitter.bright_state),
            _millionths(emitter.fidelity),
            _nanoseconds(emitter.preparation_s),
        )


Parameters = AnalyserParameters | MemoryParameters | SourceParameters | EmitterParameters
PARAMETERS: dict[int, type[Parameters]] = {
    Kind.ANALYSER: AnalyserParameters,
    Kind.MEMORY: MemoryParameters,
    Kind.SOURCE: SourceParameters,
    Kind.EMITTER: EmitterParameters,
    STATION: AnalyserParameters,
}
NAMES = {
    "kind": {**{kind.value: kind.name.lower() for kind in Kind}, STATION: "station"},
    "optics": dict(enumerate(ANALYSERS, 1)),
    "statistics": dict(enumerate(STATISTICS)),
    "scheme": dict(enumerate(SCHEMES)),
}


def describe(port: InnerPort, parts: Device) -> bytes:
    """Return the property of an inner port; `parts` are the switch's."""
    kind = wire_kind(port, parts)
    parameters = PARAMETERS[kind].of(parts)
    length = HEAD.size + parameters.FIELDS.size
    head = HEAD.pack(
        OFPPDPT_EXPERIMENTER, length, EXPERIMENTER, INNER_PORT, kind, port.which, port.number
    )
    return head + parameters.FIELDS.pack(*astuple(parameters)) + bytes(-length % 8)


def wire_kind(port: InnerPort, parts: Device) -> int:
    """Return the kind that the property names."""
    optics = parts.analyser.kind in ("linear", BEAM_SPLITTER)
    return STATION if port.kind == Kind.ANALYSER and optics else port.kind


def _millionths(share: float) -> int:
    return round(share * 1e6)


def _nanoseconds(time_s: float) -> int:
    return min(NEVER_NS, round(min(time_s, NEVER_NS / 1e9) * 1e9))
