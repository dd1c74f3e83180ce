"""Options of key distribution."""

from dataclasses import dataclass
from importlib.util import find_spec
from typing import Any

from applications.qkd.messages import Bound, Reconciliation
from applications.qkd.parameters import Parameters
from hosts.middleware.session.errors import unsupported
from hosts.middleware.session.options import MAX_BLOCK_PAIRS, MAX_BLOCK_PULSES, ServiceOptions
from hosts.timeouts import MAX_BLOCK_S
from wire.parameters.option import option

CORRECTIONS = {kind.name.lower(): kind for kind in Reconciliation}  # what users call them
BOUNDS = {kind.name.lower(): kind for kind in Bound}
MAX_SIFTED = 1_000_000_000_000  # bits of a session
MAX_SECONDS = 366 * 86_400.0
MAX_SIFTED_PER_KEY = 1_000_000  # the last block may bring more: MAX_KEY_BITS


def bound_option() -> Any:
    text = "of the key's length: proven, or that of endless keys (finite)"
    return option("finite", text, choices=tuple(BOUNDS))


@dataclass(frozen=True)
class KeyOptions(ServiceOptions):
    """`count` sifted bits at least, of which keys are distilled one after another.

    Or keys for some seconds of the network, however many bits they are of.
    """

    count: int = option(
        500_000,
        "sifted bits (500,000)",
        metavar="N",
        range=(1, MAX_SIFTED),
        instead_of="length",
    )
    # No key is begun later than that; 0: by the count.
    seconds: float = option(
        0.0,
        "make keys for this time of the network, whatever the number of bits",
        metavar="S",
        instead_of="length",
    )
    # Keys are alike in that.
    sifted_per_key: int = option(
        MAX_SIFTED_PER_KEY,
        f"sifted bits that one key is distilled of, at most ({MAX_SIFTED_PER_KEY:,})",
        metavar="N",
        range=(1, MAX_SIFTED_PER_KEY),
    )
    block_pairs: int = option(
        131_072,
        f"pairs or pulses in a block (131072); {MAX_BLOCK_PAIRS} at most, but of bb84 and bbm92",
        metavar="N",
        range=(1, MAX_BLOCK_PULSES),
    )
    correction: str = option("cascade", "of errors (cascade)", choices=tuple(CORRECTIONS))
    max_qber: float = option(0.1, "no key above this error rate (0.1)", metavar="Q")
    test_fraction: float = option(0.1, "of the sifted bits, disclosed (0.1)", metavar="F")
    epsilon: float = option(1e-10, "that the key is not secret, at most (1e-10)", metavar="P")
    bound: str = bound_option()
    chsh_fraction: float = option(
        0.2, "e91: of the receiver's photons, for the CHSH test (0.2)", metavar="F"
    )
    chsh_margin: float = option(
        0.1,
        "e91: no key unless S is above 2 by this, or by five standard errors (0.1)",
        metavar="M",
    )

    def check(self) -> None:
        super().check()
        check_seconds(self.seconds)
        if CORRECTIONS.get(self.correction) == Reconciliation.LDPC:
            check_decoder()
        if self.block_pairs / self.rate_hz > MAX_BLOCK_S:
            raise unsupported(
                f"block_pairs {self.block_pairs} at rate_hz {self.rate_hz} take more than "
                f"{MAX_BLOCK_S:g} s: choose smaller blocks or a higher rate",
            )
        for name in ("max_qber", "test_fraction", "epsilon", "chsh_fraction", "chsh_margin"):
            value = getattr(self, name)
            if not isinstance(value, float) or not 0 < value < 1:
                raise unsupported(f"{name} {value!r}: choose a fraction between 0 and 1")
        try:
            self.parameters()
        except ValueError as error:
            raise unsupported(str(error)) from error

    @property
    def lasts_s(self) -> float:
        return self.seconds

    @property
    def pairs_at_a_time(self) -> int:
        return self.block_pairs if self.seconds else super().pairs_at_a_time

    def parameters(self) -> Parameters:
        """Return the parameters of both ends; ValueError if they are impossible."""
        return Parameters(
            test_fraction=self.test_fraction,
            max_qber=self.max_qber,
            eps_sec=self.epsilon,
            bound=BOUNDS[self.bound],
            reconciliation=CORRECTIONS[self.correction],
        )


def check_decoder() -> None:
    """Raise SessionError if LDPC codes cannot be decoded here (docs/packages.md)."""
    if find_spec("ldpc") is None:
        text = "ldpc is not installed, which decodes LDPC codes: pip install 'qmn[ldpc]'"
        raise unsupported(text)


def check_seconds(seconds: Any) -> None:
    """Raise SessionError unless a session can be asked to last so long."""
    is_number = isinstance(seconds, int | float) and not isinstance(seconds, bool)
    if not is_number or not 0 <= seconds <= MAX_SECONDS:
        raise unsupported(f"seconds {seconds!r}: choose up to {MAX_SECONDS:.0f}, or 0 for a count")
