"""What an application may choose for every service, checked before anything is sent."""

from dataclasses import dataclass
from typing import Any, Self

from hosts.middleware.channel import SessionError
from hosts.middleware.frame_format import MAX_BLOCK_PAIRS
from hosts.middleware.options import MAX_BLOCK_S
from wire.metadata import Reason


@dataclass(frozen=True)
class ServiceOptions:
    """Address and packetisation; a service adds its own."""

    host: str
    port: int
    count: int = 10_000  # of what the service is about, as states or pairs
    block_pairs: int = 16_384  # in a block at most
    rate_hz: int = 50_000_000  # of the source

    @classmethod
    def from_fields(cls, fields: dict[str, Any]) -> Self:
        """Check what an application sent; raise SessionError naming value and remedy."""
        try:
            options = cls(**fields)
        except TypeError as error:
            raise SessionError(Reason.UNSUPPORTED, f"unknown or missing option: {error}") from error
        options.check()
        return options

    @property
    def fidelity_ppm(self) -> int:
        """Return the pair fidelity wanted at least; 0 is any."""
        return 0

    def check(self) -> None:
        """Raise SessionError for a value out of range."""
        for name, least, most in (
            ("port", 1, 65_535),
            ("count", 1, 100_000_000),
            ("block_pairs", 1, MAX_BLOCK_PAIRS),
            ("rate_hz", 1, 4_000_000_000),
        ):
            check_whole(name, getattr(self, name), least, most)
        if min(self.block_pairs, self.count) / self.rate_hz > MAX_BLOCK_S:
            raise SessionError(
                Reason.UNSUPPORTED,
                f"block_pairs {self.block_pairs} at rate_hz {self.rate_hz} take more than "
                f"{MAX_BLOCK_S:g} s: choose smaller blocks or a higher rate",
            )
        if not isinstance(self.host, str):
            raise SessionError(Reason.UNSUPPORTED, f"host {self.host!r} is not a name")


def check_whole(name: str, value: Any, least: int, most: int) -> None:
    """Raise SessionError unless the value is a whole number in this range."""
    if not isinstance(value, int) or isinstance(value, bool) or not least <= value <= most:
        text = f"{name} is {value!r}: choose {least} to {most}"
        raise SessionError(Reason.UNSUPPORTED, text)


def check_choice(name: str, value: Any, choices: tuple[str, ...]) -> None:
    """Raise SessionError unless the value is one of these words."""
    if value not in choices:
        text = f"{name} {value!r}: choose one of {', '.join(choices)}"
        raise SessionError(Reason.UNSUPPORTED, text)
