"""The life times of a host's memory, which the two ends of a session tell each other."""

from typing import NamedTuple

import numpy as np

from hosts.middleware.session.channel import SessionError
from wire.metadata import Reason

NUMBERS = 2  # that they travel as


class Lifetimes(NamedTuple):
    """T1 and T2 in seconds, infinite where nothing decays."""

    t1_s: float
    t2_s: float

    def numbers(self) -> list[int]:
        """Return them as whole numbers of 32 bits: IEEE 754, single precision."""
        return [int(bits) for bits in np.array(self, np.float32).view(np.uint32)]

    @classmethod
    def of(cls, numbers: list[int], peer: str) -> "Lifetimes":
        """Return what another end has told; SessionError for what no memory has."""
        t1_s, t2_s = np.array(numbers, np.uint32).view(np.float32).tolist()
        if not (t1_s > 0 and t2_s > 0):  # also what is not a number
            text = f"{peer} has a memory with T1 = {t1_s} s and T2 = {t2_s} s"
            raise SessionError(Reason.PROTOCOL, text)
        return cls(t1_s, t2_s)
