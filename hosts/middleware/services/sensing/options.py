"""Options of sensing."""

from dataclasses import dataclass

from hosts.middleware.services.ghz.options import GhzOptions
from wire.parameters.option import option

GHZ, SEPARATE = PROBES = ("ghz", "separate")


@dataclass(frozen=True)
class SensingOptions(GhzOptions):
    """`count` probes at each host: its qubits of `count` GHZ states, or qubits of its own."""

    probes: str = option(
        GHZ, f"qubits of GHZ states of all, or as many of each host's own ({GHZ})", choices=PROBES
    )
