"""The interface of any optical switch to the agent, which each driver implements."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from typing import NamedTuple, Protocol

from wire.analyser_frames import AnalyserCounts, AnalyserFrame, Emission, MemoryCounts


class HardwareRefusal(Exception):
    """The hardware cannot do this; it goes on as before and can be asked for something else."""


class HardwareFault(Exception):
    """The hardware does not work (any more); the message names cause and remedy."""


class CrossConnect(NamedTuple):
    """A way for light through the switch, by OpenFlow port numbers."""

    in_port: int
    out_port: int
    circuit: int = 0  # name under which photons are counted; a new one begins at 0


@dataclass(frozen=True)
class Path:
    loss_db: float = 0.0
    rotation: int = 0  # wire.outcomes.Pauli


@dataclass(frozen=True)
class Tuning:
    """How far each port can be tuned, and in which steps."""

    min_mhz: int
    max_mhz: int
    grid_mhz: int
    min_dbm: float
    max_dbm: float


class Channel(NamedTuple):
    """The grid of a multiplexer at a port: its frequency, and how far the next channel is."""

    mhz: int
    grid_mhz: int


@dataclass(frozen=True)
class Condition:
    """Identity and condition of the switch, apart from counts and measurements."""

    tuning: Tuning | None = None  # None: ports cannot be tuned
    others: Path = Path()  # every path that is not in `paths`
    paths: Mapping[tuple[int, int], Path] = field(default_factory=dict)  # by in_port, out_port
    stuck: frozenset[tuple[int, int]] = frozenset()  # paths that cannot be changed
    failed: frozenset[int] = frozenset()  # inner ports whose parts have failed
    cutoffs_s: Mapping[int, float] = field(default_factory=dict)  # of memories, if set
    memory: Mapping[str, float] = field(default_factory=dict)  # settings of all that were adjusted
    hot: bool = False  # above its limit: its paths lose more than they did
    channels: Mapping[int, Channel] = field(default_factory=dict)  # ports that multiplexers fix


@dataclass(frozen=True)
class PortReading:
    """Counts and measurements of a port; a power of None has no reading."""

    photons_in: int = 0  # came from the fibre
    photons_out: int = 0  # went into the fibre
    photons_lost: int = 0  # of those that came in, did not leave anywhere
    tx_mhz: int = 0  # to which the filter for light that leaves is tuned
    rx_mhz: int = 0  # and that for light that comes in
    tx_dbm: float | None = None  # launched into the fibre
    rx_dbm: float | None = None  # from the fibre
    bias_ma: float = 0.0


@dataclass(frozen=True)
class CircuitReading:
    """How much light a cross-connect has passed."""

    photons: int
    since_ns: int  # when it was made, in time of the network since 1970
    last_ns: int  # when the last photon passed; since_ns if none has


class Quantity(Enum):
    """Quantities that a switch may lack the means to count or measure."""

    PHOTONS = "photons"  # of ports and circuits: light may pass all the same
    FREQUENCY = "frequency"
    TX_POWER = "tx power"
    RX_POWER = "rx power"
    BIAS = "bias current"
    TEMPERATURE = "temperature"


@dataclass(frozen=True)
class Readings:
    """All of them at one moment; what is not measured is 0 and says nothing."""

    ports: Mapping[int, PortReading] = field(default_factory=dict)  # by OpenFlow port number
    circuits: Mapping[int, CircuitReading] = field(default_factory=dict)  # by name
    temperature_c: float = 0.0
    memories: Sequence[MemoryCounts] = ()
    analysers: Sequence[AnalyserCounts] = ()  # by port
    not_measured: frozenset[Quantity] = frozenset()

    @property
    def counts_photons(self) -> bool:
        """Whether the numbers of photons say anything."""
        return Quantity.PHOTONS not in self.not_measured


class Direction(Enum):
    """Which of a port's filters."""

    BOTH = "both"
    RECEIVE = "receive"  # for light that comes from the fibre
    TRANSMIT = "transmit"  # for light that goes into it


class OpticalHardware(Protocol):
    """An N x N cross-connect for light, which measures nothing that passes; analysers, memories,
    sources of pairs.

    Every call raises HardwareRefusal or HardwareFault, and none but those that watch takes longer
    than CALL_DEADLINE_S.
    """

    async def set_cross_connects(self, cross_connects: Iterable[CrossConnect]) -> None:
        """Make exactly these cross-connects, all at once, and return when light passes.

        Those that were there before, by in_port and out_port, are not interrupted.
        """

    async def tune(
        self,
        port: int,
        frequency_mhz: int | None,
        power_dbm: float | None,
        direction: Direction = Direction.BOTH,
        cutoff_s: float | None = None,
    ) -> None:
        """Tune a port, within the condition's `tuning`; None leaves a value as it is.

        A memory's port has a cut-off alone.
        """

    async def read(self) -> Readings:
        """Return what the hardware counts and measures."""

    async def watch(self, on_condition: Callable[[Condition], None]) -> None:
        """Report the condition at once and after each change; raise HardwareFault at the end."""

    async def watch_analysers(self, on_report: Callable[[AnalyserFrame], None]) -> None:
        """Report each block that ends in a part of the switch; raise HardwareFault at the end."""

    async def emit(self, port: int, emission: Emission) -> None:
        """Have the pair source of a port make pairs; return when it has begun."""

    async def keep(self, chosen: AnalyserFrame) -> None:
        """Have pulses of a memory's block, of all, those with 0 leave without gaps, and no others.

        With a method they go through a round of purification, which is reported.
        """

    async def close(self) -> None:
        """Close the hardware; its cross-connects stay."""
