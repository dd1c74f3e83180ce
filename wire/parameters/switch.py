"""The optics of a quantum switch: each parameter with unit, range and default, declared here alone.

The default loses nothing and takes 100 ns to switch.
"""

from collections.abc import Collection
from dataclasses import dataclass, field, fields

from wire.outcomes import PAULIS
from wire.parameters.physics import BadParameter, check, parameter

TEMPERATURE_C = (-100.0, 300.0)
LOSS_DB = (0.0, 100.0)
FREQUENCY_MHZ = (1, 2**32 - 1)
ROTATIONS = (0, len(PAULIS) - 1, ", ".join(PAULIS))


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
    switching_time_s: float = parameter(100e-9, 0.0, 60.0)
    insertion_loss_db: float = parameter(0.0, *LOSS_DB)
    rotation: int = parameter(0, *ROTATIONS)  # wire.outcomes.Pauli that every path applies
    # Of what leaves it, X, Y and Z each with p/4.
    depolarizing: float = parameter(0.0, 0.0, 1.0)
    paths: list[PathOptics] = field(default_factory=list)  # that differ from the rest
    # None: none; else a photon strays with 10^(-dB/10), into an output in use or a dark port.
    crosstalk_db: float | None = parameter(None, *LOSS_DB)
    temperature_c: float = parameter(25.0, *TEMPERATURE_C)
    max_temperature_c: float = parameter(60.0, *TEMPERATURE_C)
    hot_loss_db: float = parameter(3.0, *LOSS_DB)  # more on every path while it is hotter than that
    min_frequency_mhz: int = parameter(191_350_000, *FREQUENCY_MHZ)  # C band
    max_frequency_mhz: int = parameter(196_100_000, *FREQUENCY_MHZ)
    grid_mhz: int = parameter(50_000, *FREQUENCY_MHZ)
    min_power_dbm: float = parameter(-20.0, -100.0, 0.0)

    def check(self) -> None:
        """Raise BadParameter for optics that cannot be, whatever the switch's ports are."""
        check(self.name, self)
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


OPTICS = frozenset(each.name for each in fields(QuantumSwitch)) - {"name"}  # what can be set
