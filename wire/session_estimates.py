"""Estimates that hosts have made of the light of their sessions, in the envelope of wire.device.

node agent                   controller
SessionEstimate ->           unasked (its session field is 0), when an estimate has changed
"""

import struct
from dataclasses import dataclass, replace
from enum import IntEnum
from math import isfinite
from typing import NamedTuple

from wire.malformed import MalformedPacket
from wire.metadata.header import Message

MOST = 4  # of any estimate: S of CHSH is a sum of four correlations


class Quantity(IntEnum):
    """What was estimated; rates are from 0 to 1."""

    FIDELITY = 1  # of pairs or states to those that were wanted
    QBER = 2  # of a key, in conference keys that in X
    CHSH = 3  # S: at most 2 without entanglement
    ERROR_RATE = 4  # of symbols before any code, or of compared pairs


class Interval(NamedTuple):
    """An estimate and its 95 % confidence interval."""

    value: float
    low: float
    high: float


@dataclass(frozen=True)
class SessionEstimate(Message):
    """Tell an estimate that a session has made of its light, with its 95 % interval."""

    KIND = 43
    FIELDS = struct.Struct("!QBddd")

    about: int  # the session
    quantity: int
    value: float
    low: float
    high: float

    @property
    def interval(self) -> Interval:
        return Interval(self.value, self.low, self.high)

    @classmethod
    def parse(cls, session: int, body: bytes) -> "SessionEstimate":
        """Build the message from its body; raise MalformedPacket if it does not fit."""
        raw = super().parse(session, body)
        assert isinstance(raw, SessionEstimate)
        if raw.quantity not in set(Quantity):
            raise MalformedPacket(f"SessionEstimate: unknown quantity {raw.quantity}")
        inside = all(isfinite(bound) and abs(bound) <= MOST for bound in raw.interval)
        if not inside or not raw.low <= raw.value <= raw.high:
            raise MalformedPacket(f"SessionEstimate: {raw.interval} is not an estimate")
        return replace(raw, quantity=Quantity(raw.quantity))
