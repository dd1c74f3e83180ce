"""The optics of a quantum switch: each parameter with unit, range and default, declared here alone.

The default loses nothing and takes 100 ns to switch.
"""

from collections.abc import Collection
from dataclasses import dataclass, field, fields, replace
from enum import IntEnum
from typing import NamedTuple

from wire.features import EMIT, HERALD
from wire.outcomes import PAULIS
from wire.parameters.physics import (
    ERROR_RATE,
    OURS,
    PAPER,
    BadParameter,
    BellAnalyser,
    Compensator,
    Detectors,
    Device,
    Emitter,
    Gates,
    Memory,
    PairSource,
    check,
    parameter,
)

TEMPERATURE_C = (-100.0, 300.0)
LOSS_DB = (0.0, 100.0)
FREQUENCY_MHZ = (1, 2**32 - 1)
GRID, C_BAND = "ITU-T G.694.1", "ITU-T G.694.1: 96 channels"
ROTATIONS = (0, len(PAULIS) - 1, ", ".join(PAULIS))
# OpenFlow numbers of ports inside a switch, where no fibre ends.
FIRST_INNER_PORT, FIRST_MEMORY_PORT, FIRST_SOURCE_PORT = 60_001, 61_001, 62_001
FIRST_EMITTER_PORT = 63_001
MOST_ANALYSERS, MOST_MEMORIES, MOST_SOURCES = 64, 256, 64
INNER_PORTS = range(60_001, 65_280)  # all such numbers; Open vSwitch reserves those behind
HALVES = 2  # of a pair: an analyser has an input for each, a source an output


class Kind(IntEnum):
    """A part of a switch, as the description of its port says."""

    ANALYSER = 1
    MEMORY = 2
    SOURCE = 3
    EMITTER = 4  # of a memory: by this port it emits, and what it holds leaves by the other


class InnerPort(NamedTuple):
    kind: Kind
    number: int  # of the part, of all of its kind, from 1
    which: int  # input of an analyser, or half of a source's pairs, from 1; of a memory 0

    def node(self, switch: str) -> str:
        """Return the name of the node that the part is to light."""
        kind = Kind.MEMORY if self.kind == Kind.EMITTER else self.kind
        return f"{switch}-{kind.name.lower()}{self.number}"

    def name(self, switch: str) -> str:
        if self.kind in (Kind.MEMORY, Kind.EMITTER):
            return self.node(switch) + "e" * (self.kind == Kind.EMITTER)
        part = "bell" if self.kind == Kind.ANALYSER else "pair"
        return f"{switch}-{part}{self.number}{' ab'[self.which]}"


@dataclass(frozen=True)
class PathOptics:
    """A path of a quantum switch whose optics differ from those of the others."""

    in_port: int
    out_port: int
    insertion_loss_db: float = parameter(0.0, *LOSS_DB)
    rotation: int = parameter(0, *ROTATIONS)  # wire.outcomes.Pauli


@dataclass(frozen=True)
class QuantumSwitch:
    """The optics of a quantum switch.

    The dispatcher models them; a topology gives them as keywords of OpticalSwitch.
    """

    name: str
    switching_time_s: float = parameter(100e-9, 0.0, 60.0, source=PAPER)
    insertion_loss_db: float = parameter(0.0, *LOSS_DB)
    rotation: int = parameter(0, *ROTATIONS)  # wire.outcomes.Pauli that every path applies
    # Of what leaves it, X, Y and Z each with p/4.
    depolarizing: float = parameter(0.0, 0.0, 1.0)
    paths: list[PathOptics] = field(default_factory=list)  # that differ from the rest
    # None: none; else a photon strays with 10^(-dB/10), into an output in use or a dark port.
    crosstalk_db: float | None = parameter(None, *LOSS_DB)
    temperature_c: float = parameter(25.0, *TEMPERATURE_C, source=OURS)
    max_temperature_c: float = parameter(60.0, *TEMPERATURE_C, source=OURS)
    hot_loss_db: float = parameter(3.0, *LOSS_DB, source=OURS)  # more, while it is hotter than that
    min_frequency_mhz: int = parameter(191_350_000, *FREQUENCY_MHZ, source=C_BAND)
    max_frequency_mhz: int = parameter(196_100_000, *FREQUENCY_MHZ, source=C_BAND)
    grid_mhz: int = parameter(50_000, *FREQUENCY_MHZ, source=GRID)
    min_power_dbm: float = parameter(-20.0, -100.0, 0.0, source=OURS)
    analysers: int = parameter(0, 0, MOST_ANALYSERS)  # Bell analysers, each with two inner ports
    # What all analysers are like, and their parts.
    analyser: BellAnalyser = field(default_factory=BellAnalyser)
    detectors: Detectors = field(default_factory=Detectors)
    gates: Gates = field(default_factory=Gates)
    memories: int = parameter(0, 0, MOST_MEMORIES)  # quantum memories, each with an inner port
    memory: Memory = field(default_factory=Memory)  # what all of them are like
    emitter: Emitter = field(default_factory=Emitter)  # how these emit; by an inner port each
    sources: int = parameter(0, 0, MOST_SOURCES)  # of pairs, each with two inner ports
    source: PairSource = field(default_factory=PairSource)  # what all of them are like
    compensator: Compensator = field(default_factory=Compensator)  # where fibres end

    @property
    def parts(self) -> Device:
        """Return the hardware of all parts."""
        return replace(Device(), **{part: getattr(self, part) for part in PARTS})

    @property
    def analyser_device(self) -> Device:
        """The hardware of one analyser: it measures light, and can do nothing else."""
        return replace(Device(), analyser=self.analyser, detectors=self.detectors, gates=self.gates)

    @property
    def inner_ports(self) -> dict[int, InnerPort]:
        """Parts of the switch by the number of their ports."""
        return inner_ports(self.analysers, self.memories, self.sources, self.emitters)

    @property
    def emitters(self) -> int:
        """How many memories emit: all, or none."""
        return self.memories if HERALD in self.memory_device.features else 0

    @property
    def memory_device(self) -> Device:
        return replace(Device(), memory=self.memory, emitter=self.emitter)

    @property
    def inner_devices(self) -> dict[str, Device]:
        """The hardware of each part, by the name of its node."""
        # Gates and detectors purify.
        memory = replace(self.memory_device, gates=self.gates, detectors=self.detectors)
        devices = {
            Kind.ANALYSER: self.analyser_device,
            Kind.MEMORY: memory,
            Kind.EMITTER: memory,
            Kind.SOURCE: replace(Device(), source=self.source),
        }
        return {port.node(self.name): devices[port.kind] for port in self.inner_ports.values()}

    def check(self) -> None:
        """Raise BadParameter for optics that cannot be, whatever the switch's ports are."""
        check(self.name, self)
        self.analyser_device.check(f"{self.name}, analysers")
        if self.analysers and (self.rotation or any(path.rotation for path in self.paths)):
            raise BadParameter(
                f"{self.name} rotates light, and its analysers do not know that: take rotation=0"
            )
        if not self.analysers and self.analyser_device != Device():
            raise BadParameter(
                f"{self.name}: analyser, detectors or gates without analysers have no effect; "
                "give analysers=1 or more, too"
            )
        self._check_memories()
        self._check_sources()
        replace(Device(), compensator=self.compensator).check(self.name)
        if self.compensator.reference == ERROR_RATE:
            raise BadParameter(f"{self.name} measures no errors: choose light as a reference")
        if self.min_frequency_mhz > self.max_frequency_mhz:
            raise BadParameter(
                f"{self.name}: min_frequency_mhz {self.min_frequency_mhz} is above "
                f"max_frequency_mhz {self.max_frequency_mhz}; name the lower one first"
            )
        named = set()
        for path in self.paths:
            ports, where = (path.in_port, path.out_port), self._where(path)
            if ports in named:
                raise BadParameter(f"{where} is named twice; name each path once")
            named.add(ports)
            check(where, path)

    def _check_memories(self) -> None:
        memory, where = self.memory, f"{self.name}, memories"
        self.memory_device.check(where)
        if not self.memories and self.memory_device != Device():
            raise BadParameter(
                f"{self.name}: memory or emitter without memories has no effect; give memories=1 "
                "or more, too"
            )
        if memory.noise:
            raise BadParameter(f"{where} have no noise models of one's own")
        absorbs = memory.kind == Memory().kind or self.emitters
        if not absorbs or not memory.heralds_perfectly or not memory.capacity:
            raise BadParameter(
                f"{where} take in light or emit, and tell what they hold: leave herald_efficiency "
                "and false_herald out, give an emissive kind an emitter.scheme, and take a "
                "capacity of 1 or more"
            )

    def _check_sources(self) -> None:
        device, where = replace(Device(), source=self.source), f"{self.name}, sources"
        device.check(where)
        if not self.sources and device != Device():
            raise BadParameter(
                f"{self.name}: source without sources has no effect; give sources=1 or more, too"
            )
        if device.noises or EMIT not in device.features:
            raise BadParameter(f"{where} make pairs, and have no noise models of one's own")

    def check_ports(self, ports: Collection[int]) -> None:
        """Raise BadParameter for a path whose ports no fibre ends in."""
        for path in self.paths:
            for port in (path.in_port, path.out_port):
                if port not in ports:
                    names = ", ".join(map(str, sorted(ports))) or "none"
                    raise BadParameter(
                        f"{self._where(path)}: no fibre ends in port {port!r}; "
                        f"fibres end in {names}"
                    )

    def _where(self, path: PathOptics) -> str:
        return f"{self.name}, path {path.in_port} -> {path.out_port}"


def inner_ports(
    analysers: int, memories: int = 0, sources: int = 0, emitters: int = 0
) -> dict[int, InnerPort]:
    """Return parts of a switch by the number of their ports."""
    numbers = [FIRST_INNER_PORT + place for place in range(HALVES * analysers)]
    numbers += [FIRST_MEMORY_PORT + place for place in range(memories)]
    numbers += [FIRST_SOURCE_PORT + place for place in range(HALVES * sources)]
    numbers += [FIRST_EMITTER_PORT + place for place in range(emitters)]
    return {number: inner_port(number) for number in numbers}


def inner_port(number: int) -> InnerPort:
    """Return what a port leads to, by its number from FIRST_INNER_PORT on."""
    if FIRST_MEMORY_PORT <= number < FIRST_SOURCE_PORT:
        return InnerPort(Kind.MEMORY, number - FIRST_MEMORY_PORT + 1, 0)
    if number >= FIRST_EMITTER_PORT:
        return InnerPort(Kind.EMITTER, number - FIRST_EMITTER_PORT + 1, 0)
    source = number >= FIRST_SOURCE_PORT
    kind, first = (Kind.SOURCE, FIRST_SOURCE_PORT) if source else (Kind.ANALYSER, FIRST_INNER_PORT)
    place = number - first
    return InnerPort(kind, place // HALVES + 1, place % HALVES + 1)


def memory_of(port: int) -> int:
    """Return the port of the memory that emits by one; 0 for any other port."""
    emits = FIRST_EMITTER_PORT <= port < INNER_PORTS.stop
    return port - FIRST_EMITTER_PORT + FIRST_MEMORY_PORT if emits else 0


OPTICS = frozenset(each.name for each in fields(QuantumSwitch)) - {"name"}  # what can be set
PARTS = frozenset(each.name for each in fields(Device)) & OPTICS
COMPOUND = PARTS | {"paths"}  # of these, by topologies alone
