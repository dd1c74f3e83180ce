"""Options of conference key agreement."""

from dataclasses import dataclass

from hosts.middleware.services.ghz.options import GhzOptions
from hosts.middleware.services.key_distribution.options import BOUNDS
from hosts.middleware.session.errors import SessionError
from hosts.middleware.session.options import check_choice, check_whole
from wire.metadata.vocabulary import Reason

MAX_STATES = 1_000_000  # of one key: the seed of its privacy amplification is one message


@dataclass(frozen=True)
class ConferenceOptions(GhzOptions):
    """`count` states that all hosts have seen, of which one key is distilled."""

    count: int = 100_000
    test_fraction: float = 0.1  # of the states, in X, and as many in Z
    max_qber: float = 0.1  # of any test: no key above
    epsilon: float = 1e-10  # the key is secret but for this probability
    bound: str = "finite"

    def check(self) -> None:
        """Raise SessionError for a value out of range."""
        super().check()
        check_whole("count", self.count, 1, MAX_STATES)
        check_choice("bound", self.bound, tuple(BOUNDS))
        for name, most in (("test_fraction", 0.5), ("max_qber", 0.5), ("epsilon", 1)):
            value = getattr(self, name)
            if not isinstance(value, float) or not 0 < value < most:
                text = f"{name} {value!r}: choose a fraction between 0 and {most}"
                raise SessionError(Reason.UNSUPPORTED, text)
