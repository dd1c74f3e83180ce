"""Options of entanglement distribution."""

from dataclasses import dataclass

from hosts.middleware.services.distribution.purification import Protocol
from hosts.middleware.session.errors import SessionError
from hosts.middleware.session.options import check_choice, check_share, check_whole
from hosts.middleware.session.service_options import ServiceOptions
from wire.metadata.vocabulary import Reason

PROTOCOLS = tuple(protocol.name.lower() for protocol in Protocol)  # what users call them
MAX_COUNT = 1_000_000
MAX_ROUNDS = 8
MAX_SAMPLE = 0.9


@dataclass(frozen=True)
class DistributeOptions(ServiceOptions):
    """`count` pairs of this fidelity to Phi+ at least."""

    fidelity: float = 0.0  # 0: any
    sample: float = 0.1  # share of the pairs that is sacrificed for the estimate
    purification: str = "dejmps"
    rounds: int | None = None  # of purification; None: as many as the fidelity needs

    @property
    def fidelity_ppm(self) -> int:
        """Return the pair fidelity wanted at least; 0 is any."""
        return round(self.fidelity * 1_000_000)

    def check(self) -> None:
        """Raise SessionError for a value out of range."""
        super().check()
        check_whole("count", self.count, 1, MAX_COUNT)
        check_share("fidelity", self.fidelity, 0, 1)
        check_share("sample", self.sample, 0, MAX_SAMPLE)
        check_choice("purification", self.purification, PROTOCOLS)
        if self.rounds is not None:
            check_whole("rounds", self.rounds, 0, MAX_ROUNDS)
        if self.rounds and self.purification == "none":
            text = f"rounds is {self.rounds} and purification none: choose bbpssw or dejmps"
            raise SessionError(Reason.UNSUPPORTED, text)
        if self.fidelity and not self.sample:
            text = f"fidelity {self.fidelity} cannot be known with sample 0: choose 0.1, say"
            raise SessionError(Reason.UNSUPPORTED, text)
