"""Estimates that hosts have made of the light of their sessions, in the envelope of wire.device.

node agent                   controller
SessionEstimate ->           unasked (its session field is 0), when an estimate has changed

Commands of the controller to hosts that watch idle light, in the envelope of wire.device.

controller                   node agents
MonitorCommand               ->  first of the host that takes part, then of the one that opens
                             <-  Answer
PreemptMonitor               ->  of the opener of a link monitor whose light a session wants
                             <-  Answer
"""

import struct
from dataclasses import dataclass, replace
from enum import IntEnum
from ipaddress import IPv4Address
from math import isfinite
from typing import NamedTuple

from wire.malformed import MalformedPacket
from wire.metadata.header import Message

ENDS = ("opener", "acceptor")
CHANCES = ("whole_error", "fraction", "false_alarm", "missed")


@dataclass(frozen=True)
class MonitorCommand(Message):
    """Command a host to open a link monitor, or to take part in one, by its address."""

    KIND = 40
    FIELDS = struct.Struct("!Q4s4sIIIdddd")

    monitor: int  # its session
    opener: str  # IPv4 address of the host that opens it and makes its pairs
    acceptor: str
    pairs: int  # to compare, unless there is an alarm before
    block_pairs: int
    rate_hz: int
    whole_error: float  # see applications.sealing
    fraction: float
    false_alarm: float
    missed: float

    def encode(self) -> bytes:
        hosts = {name: IPv4Address(getattr(self, name)).packed for name in ENDS}
        _session, *fields = {**vars(self), **hosts}.values()
        return self._frame(self.FIELDS.pack(*fields))

    @classmethod
    def parse(cls, session: int, body: bytes) -> "MonitorCommand":
        raw = super().parse(session, body)
        assert isinstance(raw, MonitorCommand)
        opener, acceptor = (str(IPv4Address(getattr(raw, name))) for name in ENDS)
        if opener == acceptor:
            raise MalformedPacket(f"MonitorCommand: {opener} is at both ends")
        if not all(isfinite(getattr(raw, name)) for name in CHANCES):
            raise MalformedPacket(f"MonitorCommand {raw.monitor:016x}: a chance is not a number")
        return replace(raw, opener=opener, acceptor=acceptor)


@dataclass(frozen=True)
class PreemptMonitor(Message):
    """Command a host to end a link monitor that it has opened: a session wants its light."""

    KIND = 41
    FIELDS = struct.Struct("!Q")

    monitor: int  # its session


MOST = 4  # of any estimate: S of CHSH is a sum of four correlations


class Quantity(IntEnum):
    """The estimated quantity; rates are from 0 to 1."""

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
        raw = super().parse(session, body)
        assert isinstance(raw, SessionEstimate)
        if raw.quantity not in set(Quantity):
            raise MalformedPacket(f"SessionEstimate: unknown quantity {raw.quantity}")
        inside = all(isfinite(bound) and abs(bound) <= MOST for bound in raw.interval)
        if not inside or not raw.low <= raw.value <= raw.high:
            raise MalformedPacket(f"SessionEstimate: {raw.interval} is not an estimate")
        return replace(raw, quantity=Quantity(raw.quantity))
