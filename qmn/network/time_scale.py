"""The two ways in which a network's time passes, as options name them."""

import argparse
from dataclasses import dataclass
from typing import Self

from wire.network_time import LEAST_SCALE, MOST_SCALE, NetworkTime

PACED, STEPPED = "paced", "stepped"


@dataclass(frozen=True)
class Pace:
    stepped: bool = True
    scale: float = 1.0  # if it is paced: seconds here for one of the network
    reason: str = ""  # empty: somebody has named it, or it is usual

    @classmethod
    def of(cls, text: str | None) -> Self:
        """Return the pace of an option; raise ValueError for a scale out of range."""
        mode, _equals, scale = (text or STEPPED).partition("=")
        return cls(mode == STEPPED, NetworkTime(float(scale or 1)).scale)


def time_mode(text: str) -> str:
    """Return the text of stepped, paced or paced=K; raise ArgumentTypeError for any other."""
    mode, equals, scale = text.partition("=")
    try:
        if text == STEPPED or (mode == PACED and bool(equals) == bool(scale)):
            Pace.of(text)
            return text
    except ValueError:
        pass
    raise argparse.ArgumentTypeError(
        f"{text}: choose {STEPPED}, {PACED}, or {PACED}=K with {LEAST_SCALE:g} to {MOST_SCALE:g} "
        "seconds here for one second of the network"
    )
