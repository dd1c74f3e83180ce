"""The life times of a host's memory, which the two ends of a session tell each other."""

from typing import NamedTuple

import numpy as np

from hosts.middleware.session.errors import SessionError
from wire.metadata import Reason

NUMBERS = 3  # that they travel as


class Lifetimes(NamedTuple):
    """T1, T2 and the time of depolarising in seconds, infinite where nothing decays."""

    t1_s: float
    t2_s: float
    depolarizing_s: float

    def numbers(self) -> list[int]:
        """Return them as whole numbers of 32 bits: IEEE 754, single precision."""
        return [int(bits) for bits in np.array(self, np.float32).view(np.uint32)]

    @classmethod
    def of(cls, numbers: list[int], peer: str) -> "Lifetimes":
        """Return what another end has told; SessionError for what no memory has."""
        times = cls(*np.array(numbers, np.uint32).view(np.float32).tolist())
        if not all(time_s > 0 for time_s in times):  # also what is not a number
            text = f"{peer} has a memory with T1 = {times.t1_s} s and T2 = {times.t2_s} s"
            noise = f", and is depolarised in {times.depolarizing_s} s"
            raise SessionError(Reason.PROTOCOL, text + noise)
        return times
