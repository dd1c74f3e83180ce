"""Options of a session, checked before anything is sent."""

from dataclasses import dataclass, fields, replace
from typing import Any, Self

from hosts.middleware.session.errors import SessionError
from hosts.timeouts import MAX_BLOCK_S
from wire.device import OF_LIGHT, DeviceSettings
from wire.metadata.setup import Setup
from wire.metadata.vocabulary import Reason
from wire.parameters.checks import check_names, check_number
from wire.parameters.option import check_options

MAX_FRAME_BYTES = 1 << 16
MAX_BLOCK_PAIRS = 1 << 18
MIN_BLOCK_PAIRS = 4
MAX_RATE_HZ = 4_000_000_000


def unsupported(text: str) -> SessionError:
    return SessionError(Reason.UNSUPPORTED, text)


@dataclass(frozen=True)
class Options:
    """Checks of every session; each kind of session has further options."""

    @classmethod
    def from_fields(cls, given: dict[str, Any]) -> Self:
        """Check what an application sent; raise SessionError naming value and remedy."""
        known = [field.name for field in fields(cls)]
        check_names("a session", given, known, unsupported)
        try:
            options = cls(**given)
        except TypeError as error:
            raise SessionError(Reason.UNSUPPORTED, f"missing option: {error}") from error
        options.check()
        return options

    def check(self) -> None:
        """Raise SessionError for a value out of its range, or not among its choices."""
        check_options(self, unsupported)


def check_where(host: Any, port: Any) -> None:
    """Raise SessionError unless these are the name of a host, and a port."""
    if not isinstance(host, str):
        raise SessionError(Reason.UNSUPPORTED, f"host {host!r} is not a name")
    check_number("port", port, 1, 65_535, unsupported)


def check_block_time(pairs: int, block_pairs: int, rate_hz: int) -> None:
    """Raise SessionError if a block of the requested pairs takes too long."""
    if pairs / rate_hz > MAX_BLOCK_S:
        raise SessionError(
            Reason.UNSUPPORTED,
            f"block_pairs {block_pairs} at rate_hz {rate_hz} take more than "
            f"{MAX_BLOCK_S:g} s: choose smaller blocks or a higher rate",
        )


def overridden(setup: Setup, settings: DeviceSettings) -> Setup:
    """Return a set-up with what the controller has set, in place of what was asked for.

    Blocks are made smaller where a lower rate would make them last too long.
    """
    chosen = {name: getattr(settings, name) for name in OF_LIGHT}
    given = {name: value for name, value in chosen.items() if value is not None}
    setup = replace(setup, **given)
    longest = max(MIN_BLOCK_PAIRS, int(MAX_BLOCK_S * setup.rate_hz))
    return replace(setup, pairs=min(setup.pairs, longest))
