"""Estimates that sessions make of their light, for the controller (wire.monitor_messages).

An estimate is reported again when it has left the last reported interval, or when the interval is
half as wide: so reports become rare as a session lasts. The final estimate is reported in any
case.
"""

from collections.abc import Mapping
from math import isfinite
from statistics import NormalDist
from typing import Any

from hosts.middleware.qkd.estimation import Estimate
from wire.monitor_messages import Interval, Quantity, SessionEstimate

NORMAL_95 = NormalDist().inv_cdf(0.975)  # 95 % are within this number of standard errors
MOST_UNTOLD = 1000  # estimates; the oldest go

Found = dict[Quantity, Interval]


def estimates_of(summary: Mapping[str, Any], counts: Mapping[str, int]) -> Found:
    """Return a session's estimates, from its results and the device's report."""
    estimates = {
        Quantity.FIDELITY: _estimate(summary, "fidelity"),
        Quantity.QBER: _estimate(summary, "qber")
        or _share(summary.get("qber_x"), summary.get("tests_in_x", 0)),
        Quantity.CHSH: _estimate(summary, "chsh"),
        Quantity.ERROR_RATE: _share(summary.get("error_rate"), summary.get("compared", 0))
        or _symbol_errors(counts),
    }
    return {quantity: interval for quantity, interval in estimates.items() if interval is not None}


def _estimate(summary: Mapping[str, Any], name: str) -> Interval | None:
    """Return an estimate with its interval, or with that which its standard error makes."""
    value = summary.get(name)
    if value is None or not isfinite(value):
        return None
    low, high = summary.get(f"{name}_low"), summary.get(f"{name}_high")
    if low is None or high is None:
        half = NORMAL_95 * summary[f"{name}_error"]
        low, high = value - half, value + half
    return Interval(value, min(low, value), max(high, value))


def _share(value: float | None, number: int) -> Interval | None:
    if value is None or not number:
        return None
    low, high = Estimate(round(value * number), number).interval()
    return Interval(value, min(low, value), max(high, value))


def _symbol_errors(counts: Mapping[str, int]) -> Interval | None:
    seen, wrong = counts.get("pairs_received", 0), counts.get("symbol_errors")
    return None if wrong is None or not seen else _share(min(wrong / seen, 1.0), seen)


class Estimates:
    def __init__(self) -> None:
        self._told: dict[tuple[int, Quantity], Interval] = {}  # of sessions that go on
        self._untold: dict[tuple[int, Quantity], Interval] = {}

    def note(self, session: int, found: Found, over: bool = False) -> None:
        """Take what a session knows now, for the last time if it is over."""
        for quantity, interval in found.items():
            before = self._told.get((session, quantity))
            if before is None or (over and interval != before) or _is_news(before, interval):
                self._told[session, quantity] = self._untold[session, quantity] = interval
        while len(self._untold) > MOST_UNTOLD:
            del self._untold[next(iter(self._untold))]
        if over:
            for quantity in Quantity:
                self._told.pop((session, quantity), None)

    def take(self) -> list[SessionEstimate]:
        untold, self._untold = self._untold, {}
        return [
            SessionEstimate(0, session, quantity, *interval)
            for (session, quantity), interval in untold.items()
        ]


def _is_news(before: Interval, now: Interval) -> bool:
    width = before.high - before.low
    outside = not before.low <= now.value <= before.high
    return outside or (width > 0 and now.high - now.low <= width / 2)
