"""Options of key distribution."""

from dataclasses import dataclass
from typing import Any, ClassVar

from hosts.middleware.qkd.parameters import Parameters
from hosts.middleware.session.errors import SessionError
from hosts.middleware.session.options import check_choice, check_whole
from hosts.middleware.session.service_options import ServiceOptions
from hosts.timeouts import MAX_BLOCK_S
from wire.metadata.vocabulary import Reason
from wire.qkd import Bound, Reconciliation

CORRECTIONS = {kind.name.lower(): kind for kind in Reconciliation}  # what users call them
BOUNDS = {kind.name.lower(): kind for kind in Bound}
MAX_SIFTED = 1_000_000_000_000  # bits of a session
MAX_SECONDS = 366 * 86_400.0
MAX_SIFTED_PER_KEY = 1_000_000  # the last block may bring some more: wire.qkd.MAX_KEY_BITS


@dataclass(frozen=True)
class KeyOptions(ServiceOptions):
    """`count` sifted bits at least, of which keys are distilled one after another.

    Or keys for some seconds of the network, however many bits they are of.
    """

    MOST: ClassVar[int] = MAX_SIFTED
    count: int = 500_000
    seconds: float = 0.0  # instead of a count: no key is begun later than that; 0: by the count
    sifted_per_key: int = MAX_SIFTED_PER_KEY  # at most; keys are alike in that
    block_pairs: int = 131_072
    correction: str = "cascade"
    max_qber: float = 0.1  # of the disclosed sample: no key above
    test_fraction: float = 0.1  # of the sifted bits, disclosed to estimate the error rate
    epsilon: float = 1e-10  # the key is secret but for this probability
    bound: str = "finite"
    chsh_fraction: float = 0.2  # of E91: of the acceptor's photons, for the CHSH test
    chsh_margin: float = 0.1  # of E91: S has to be above 2 by this, or by five standard errors

    def check(self) -> None:
        """Raise SessionError for a value out of range."""
        super().check()
        check_seconds(self.seconds)
        check_whole("sifted_per_key", self.sifted_per_key, 1, MAX_SIFTED_PER_KEY)
        check_choice("correction", self.correction, tuple(CORRECTIONS))
        check_choice("bound", self.bound, tuple(BOUNDS))
        if self.block_pairs / self.rate_hz > MAX_BLOCK_S:
            raise SessionError(
                Reason.UNSUPPORTED,
                f"block_pairs {self.block_pairs} at rate_hz {self.rate_hz} take more than "
                f"{MAX_BLOCK_S:g} s: choose smaller blocks or a higher rate",
            )
        for name in ("max_qber", "test_fraction", "epsilon", "chsh_fraction", "chsh_margin"):
            value = getattr(self, name)
            if not isinstance(value, float) or not 0 < value < 1:
                text = f"{name} {value!r}: choose a fraction between 0 and 1"
                raise SessionError(Reason.UNSUPPORTED, text)
        try:
            self.parameters()
        except ValueError as error:
            raise SessionError(Reason.UNSUPPORTED, str(error)) from error

    @property
    def pairs_at_a_time(self) -> int:
        """Return how many pulses or pairs a block has at most."""
        return self.block_pairs if self.seconds else super().pairs_at_a_time

    def parameters(self) -> Parameters:
        """Return what both ends must be told alike; ValueError for what cannot be."""
        return Parameters(
            test_fraction=self.test_fraction,
            max_qber=self.max_qber,
            eps_sec=self.epsilon,
            bound=BOUNDS[self.bound],
            reconciliation=CORRECTIONS[self.correction],
        )


def check_seconds(seconds: Any) -> None:
    """Raise SessionError unless a session can be asked to last so long."""
    is_number = isinstance(seconds, int | float) and not isinstance(seconds, bool)
    if not is_number or not 0 <= seconds <= MAX_SECONDS:
        text = f"seconds {seconds!r}: choose up to {MAX_SECONDS:.0f}, or 0 for a count"
        raise SessionError(Reason.UNSUPPORTED, text)
