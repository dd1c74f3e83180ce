"""What an application may choose for a session, checked before anything is sent."""

from dataclasses import dataclass, replace
from typing import Any

from hosts.middleware.channel import SessionError
from hosts.middleware.frame_format import MAX_BLOCK_PAIRS, MAX_FRAME_BYTES
from wire.device import DeviceSettings
from wire.metadata import FEC_NAMES, Handshake, Reason, Setup

HANDSHAKES = {"framed": Handshake.FRAMED, "per-pair": Handshake.PER_PAIR}

MIN_BLOCK_PAIRS = 4
MAX_BLOCK_S = 5.0  # deadlines of both ends allow for it


@dataclass(frozen=True)
class SessionOptions:
    """Address and packetisation of a session."""

    host: str
    port: int
    handshake: str = "framed"
    frame_bytes: int = 256
    block_pairs: int = 65_536
    rate_hz: int = 50_000_000  # pairs a second of the source
    fec: str = "none"  # error-correction code, one of FEC_NAMES
    interleave: bool = False  # let the bits of its codewords travel far from each other

    @classmethod
    def from_fields(cls, fields: dict[str, Any]) -> "SessionOptions":
        """Check what an application sent; raise SessionError naming value and remedy."""
        try:
            options = cls(**fields)
        except TypeError as error:
            raise SessionError(Reason.UNSUPPORTED, f"unknown or missing option: {error}") from error
        options.check()
        return options

    def check(self) -> None:
        """Raise SessionError for a value out of range."""
        for name, choices in (("handshake", HANDSHAKES), ("fec", FEC_NAMES)):
            value = getattr(self, name)
            if not isinstance(value, str) or value not in choices:
                raise SessionError(
                    Reason.UNSUPPORTED, f"{name} {value!r}: choose one of {', '.join(choices)}"
                )
        if not isinstance(self.interleave, bool):
            text = f"interleave is {self.interleave!r}: choose True or False"
            raise SessionError(Reason.UNSUPPORTED, text)
        ranges = {
            "port": (1, 65_535),
            "frame_bytes": (1, MAX_FRAME_BYTES),
            "block_pairs": (MIN_BLOCK_PAIRS, MAX_BLOCK_PAIRS),
            "rate_hz": (1, 4_000_000_000),
        }
        for name, (least, most) in ranges.items():
            value = getattr(self, name)
            if not isinstance(value, int) or not least <= value <= most:
                raise SessionError(
                    Reason.UNSUPPORTED, f"{name} is {value!r}: choose {least} to {most}"
                )
        if self.block_pairs / self.rate_hz > MAX_BLOCK_S:
            raise SessionError(
                Reason.UNSUPPORTED,
                f"block_pairs {self.block_pairs} at rate_hz {self.rate_hz} take more than "
                f"{MAX_BLOCK_S:g} s: choose smaller blocks or a higher rate",
            )
        if not isinstance(self.host, str):
            raise SessionError(Reason.UNSUPPORTED, f"host {self.host!r} is not a name")


def overridden(setup: Setup, settings: DeviceSettings) -> Setup:
    """Return a set-up with what the controller has set, in place of what was asked for.

    Blocks are made smaller where a lower rate would make them last too long.
    """
    given = {name: value for name, value in vars(settings).items() if value is not None}
    setup = replace(setup, **given)
    longest = max(MIN_BLOCK_PAIRS, int(MAX_BLOCK_S * setup.rate_hz))
    return replace(setup, pairs=min(setup.pairs, longest))
