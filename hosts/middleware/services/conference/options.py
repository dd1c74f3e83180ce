"""Options of conference key agreement."""

from dataclasses import dataclass

from hosts.middleware.services.ghz.options import GhzOptions
from hosts.middleware.services.key_distribution.options import bound_option
from hosts.middleware.session.errors import SessionError
from wire.metadata.vocabulary import Reason
from wire.parameters.option import option

MAX_STATES = 1_000_000  # of one key: the seed of its privacy amplification is one message


@dataclass(frozen=True)
class ConferenceOptions(GhzOptions):
    """`count` states that all hosts have seen, of which one key is distilled."""

    count: int = option(100_000, "states (100000)", metavar="N", range=(1, MAX_STATES))
    test_fraction: float = option(
        0.1, "of the states, tested in X, and as many in Z (0.1)", metavar="F"
    )
    max_qber: float = option(0.1, "no key above this error rate of any test (0.1)", metavar="Q")
    epsilon: float = option(1e-10, "that the key is not secret, at most (1e-10)", metavar="P")
    bound: str = bound_option()

    def check(self) -> None:
        super().check()
        for name, most in (("test_fraction", 0.5), ("max_qber", 0.5), ("epsilon", 1)):
            value = getattr(self, name)
            if not isinstance(value, float) or not 0 < value < most:
                text = f"{name} {value!r}: choose a fraction between 0 and {most}"
                raise SessionError(Reason.UNSUPPORTED, text)
