"""The life times of a host's memory, which the two ends of a session tell each other."""

from typing import NamedTuple

import numpy as np

from hosts.middleware.session.errors import SessionError
from wire.metadata import Reason

NUMBERS = 4  # that they travel as


class Lifetimes(NamedTuple):
    """T1, T2, the time of depolarising, and the cut-off, in seconds; infinite: there is none."""

    t1_s: float
    t2_s: float
    depolarizing_s: float
    cutoff_s: float  # what is older is dropped

    def numbers(self) -> list[int]:
        """Return them as whole numbers of 32 bits: IEEE 754, single precision."""
        return [int(bits) for bits in np.array(self, np.float32).view(np.uint32)]

    @classmethod
    def of(cls, numbers: list[int], peer: str) -> "Lifetimes":
        """Return what another end has told; SessionError for what no memory has."""
        times = cls(*np.array(numbers, np.uint32).view(np.float32).tolist())
        if not all(time_s > 0 for time_s in times):  # also what is not a number
            told = ", ".join(f"{name} {value}" for name, value in times._asdict().items())
            raise SessionError(Reason.PROTOCOL, f"{peer} has a memory with {told}")
        return times
