"""Options of sensing."""

from dataclasses import dataclass

from hosts.middleware.services.ghz.options import GhzOptions
from hosts.middleware.session.errors import SessionError
from wire.metadata.vocabulary import Reason

GHZ, SEPARATE = PROBES = ("ghz", "separate")


@dataclass(frozen=True)
class SensingOptions(GhzOptions):
    """`count` probes at each host: its qubits of so many GHZ states, or qubits of its own."""

    probes: str = GHZ

    def check(self) -> None:
        """Raise SessionError for a value out of range."""
        super().check()
        if self.probes not in PROBES:
            text = f"probes {self.probes!r}: choose {' or '.join(PROBES)}"
            raise SessionError(Reason.UNSUPPORTED, text)
