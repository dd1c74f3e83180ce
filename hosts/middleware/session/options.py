"""Options of a session, checked before anything is sent."""

from dataclasses import dataclass, field, fields, replace
from typing import Any, Self

from hosts.middleware.session.errors import unsupported
from hosts.timeouts import MAX_BLOCK_S
from wire.device import OF_LIGHT, DeviceSettings
from wire.metadata.setup import Setup
from wire.metadata.vocabulary import Handshake, Service
from wire.parameters.checks import check_names, check_number
from wire.parameters.option import check_options, option, recorded_as
from wire.services import BY_KEY

MAX_FRAME_BYTES = 1 << 16
MAX_BLOCK_PAIRS = 1 << 18
MAX_BLOCK_PULSES = 4_000_000_000  # of weak light, of which few are detected
MIN_BLOCK_PAIRS = 4
MAX_RATE_HZ = 4_000_000_000


@dataclass(frozen=True)
class Options:
    """Checks of every session; each kind of session has further options."""

    @classmethod
    def from_fields(cls, content: dict[str, Any]) -> Self:
        """Check what an application sent; raise SessionError naming value and remedy."""
        names = [field.name for field in fields(cls)]
        check_names("a session", content, names, unsupported)
        try:
            options = cls(**content)
        except TypeError as error:
            raise unsupported(f"missing option: {error}") from error
        options.check()
        return options

    def check(self) -> None:
        """Raise SessionError for a value out of its range, or not among its choices."""
        check_options(self, unsupported)


def check_where(host: Any, port: Any) -> None:
    """Raise SessionError unless these are the name of a host, and a port."""
    if not isinstance(host, str):
        raise unsupported(f"host {host!r} is not a name")
    check_number("port", port, 1, 65_535, unsupported)


def check_block_time(pairs: int, block_pairs: int, rate_hz: int) -> None:
    """Raise SessionError if a block of the requested pairs takes too long."""
    if pairs / rate_hz > MAX_BLOCK_S:
        raise unsupported(
            f"block_pairs {block_pairs} at rate_hz {rate_hz} take more than "
            f"{MAX_BLOCK_S:g} s: choose smaller blocks or a higher rate",
        )


def overridden(setup: Setup, settings: DeviceSettings) -> Setup:
    """Return a set-up with what the controller has set, in place of what was asked for.

    Blocks are made smaller where a lower rate would make them last too long.
    """
    chosen = {name: getattr(settings, name) for name in OF_LIGHT}
    options = {name: value for name, value in chosen.items() if value is not None}
    setup = replace(setup, **options)
    longest = max(MIN_BLOCK_PAIRS, int(MAX_BLOCK_S * setup.rate_hz))
    return replace(setup, pairs=min(setup.pairs, longest))


MAX_COUNT = 100_000_000
MOST_PRIORITY = 255
LATEST_MS = 3_600_000


def most_in_block(service: Service) -> int:
    """Return how many pairs or pulses a block may have; a source does not know what for."""
    return MAX_BLOCK_PULSES if service in BY_KEY | {Service.PAIR_SOURCE} else MAX_BLOCK_PAIRS


@dataclass(frozen=True)
class SessionAddress:
    host: str = field(metadata=recorded_as("receiver"))  # as users call who is asked
    port: int


@dataclass(frozen=True)
class SessionLight:
    block_pairs: int = option(
        16_384, "pairs in a block (16384)", metavar="N", range=(1, MAX_BLOCK_PAIRS)
    )
    rate_hz: int = option(
        50_000_000, "rate of the source (50000000)", metavar="HZ", range=(1, MAX_RATE_HZ)
    )


@dataclass(frozen=True)
class SessionSource:
    source: str = option(
        "",
        "host that makes the pairs, perhaps the one that asks (the network's)",
        metavar="HOST",
    )


@dataclass(frozen=True)
class SessionOptions(Options, SessionSource, SessionLight, SessionAddress):
    """Address and light of a session; a service adds its own."""

    # Among those that wait for light, if the controller's policy heeds it.
    priority: int = field(default=0, metadata={"range": (0, MOST_PRIORITY)})
    # Of the network, until light is wanted at the latest; 0: no deadline.
    deadline_ms: int = field(default=0, metadata={"range": (0, LATEST_MS)})

    def asked(self) -> dict[str, Any]:
        """Return the fields of the set-up message that say this."""
        return {
            "handshake": Handshake.FRAMED,
            "pairs": self.block_pairs,
            "frame_bytes": 1,
            "rate_hz": self.rate_hz,
            "port": self.port,
            "priority": self.priority,
            "deadline_ms": self.deadline_ms,
        }

    def check(self) -> None:
        """Raise SessionError for a value out of range."""
        super().check()
        if not isinstance(self.source, str):
            raise unsupported(f"source {self.source!r} is not a name")
        check_where(self.host, self.port)
        check_block_time(self.pairs_at_a_time, self.block_pairs, self.rate_hz)

    @property
    def pairs_at_a_time(self) -> int:
        """Return how many pairs a block has at most."""
        return self.block_pairs


@dataclass(frozen=True)
class ServiceOptions(SessionOptions):
    """Those of a session that is about a number of things."""

    count: int = option(
        10_000,
        "of what the service is about, as states or pairs (10000)",
        metavar="N",
        range=(1, MAX_COUNT),
    )

    @property
    def fidelity_ppm(self) -> int:
        """Return the pair fidelity wanted at least; 0 is any."""
        return 0

    @property
    def lasts_s(self) -> float:
        """Return the time that a session is to last; 0: until its count is reached."""
        return 0.0

    @property
    def names(self) -> list[str]:
        """Return the hosts of a line, in their order; a session of two has none."""
        return []

    @property
    def sends_light(self) -> bool:
        """Return whether hosts send each other light."""
        return True

    def check_backend(self, backend: str) -> None:
        """Raise SessionError for states that this backend of the dispatcher does not hold."""

    def asked(self) -> dict[str, Any]:
        return {**super().asked(), "fidelity_ppm": self.fidelity_ppm}

    @property
    def pairs_at_a_time(self) -> int:
        return min(self.block_pairs, self.count)
