"""Options of entanglement distribution."""

from dataclasses import dataclass

from hosts.middleware.services.distribution.purification import Protocol
from hosts.middleware.session.errors import SessionError
from hosts.middleware.session.service_options import ServiceOptions
from wire.metadata.vocabulary import Reason
from wire.parameters.option import option

PROTOCOLS = tuple(protocol.name.lower() for protocol in Protocol)  # what users call them
MAX_COUNT = 1_000_000
MAX_ROUNDS = 8
MAX_SAMPLE = 0.9


@dataclass(frozen=True)
class DistributeOptions(ServiceOptions):
    """`count` pairs of this fidelity to Phi+ at least."""

    fidelity: float = option(0.0, "at least, to Phi+ (0: any)", metavar="F", range=(0.0, 1))
    sample: float = option(
        0.1,
        "of the pairs, sacrificed for the estimate (0.1)",
        metavar="SHARE",
        range=(0.0, MAX_SAMPLE),
    )
    purification: str = option("dejmps", "where it is needed (dejmps)", choices=PROTOCOLS)
    rounds: int | None = option(
        None,
        "of purification (as many as the fidelity needs)",
        metavar="N",
        range=(0, MAX_ROUNDS),
    )
    count: int = option(10_000, "pairs (10000)", metavar="N", range=(1, MAX_COUNT))

    @property
    def fidelity_ppm(self) -> int:
        return round(self.fidelity * 1_000_000)

    def check(self) -> None:
        super().check()
        if self.rounds and self.purification == "none":
            text = f"rounds is {self.rounds} and purification none: choose bbpssw or dejmps"
            raise SessionError(Reason.UNSUPPORTED, text)
        if self.fidelity and not self.sample:
            text = f"fidelity {self.fidelity} cannot be known with sample 0: choose 0.1, say"
            raise SessionError(Reason.UNSUPPORTED, text)
