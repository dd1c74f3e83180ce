"""A host's device: counts over all sessions, settings, and the controller's overrides.

No socket and no clock. Sessions that have ended are added up and forgotten.

Estimates that sessions make of their light, for the controller (wire.monitor_messages).

An estimate is reported again when it has left the last reported interval, or when the interval is
half as wide: so reports become rare as a session lasts. The final estimate is reported in any
case.
"""

import logging
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from math import isfinite
from statistics import NormalDist
from typing import Any, Protocol, TypeVar

from hosts.middleware.services.superdense.coding import CODES, NAMES
from hosts.middleware.session.ends import Watched
from hosts.middleware.session.errors import unsupported
from hosts.middleware.session.estimation import Estimate
from hosts.middleware.session.options import overridden
from wire.device import DevicePort, DeviceReport, DeviceSettings, Subscribe
from wire.metadata.setup import Setup
from wire.monitor_messages import Interval, Quantity, SessionEstimate
from wire.services import MONITORS

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

    def note(self, session: int, estimates: Found, over: bool = False) -> None:
        """Take what a session knows now, for the last time if it is over."""
        for quantity, interval in estimates.items():
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


log = logging.getLogger("device")

PARTS_PER_MILLION = 1_000_000


class Counted(Protocol):
    @property
    def setup(self) -> Setup:
        """The agreed terms."""

    @property
    def counts(self) -> Mapping[str, int]:
        """Its use so far, in the names of DeviceReport."""

    @property
    def summary(self) -> Mapping[str, Any]:
        """The application's summary so far."""

    @property
    def watched(self) -> Watched | None:
        """Its findings if it watches a path, and does no more."""


class Opened(Counted, Protocol):
    """A session that this host has asked for."""

    def preempt(self) -> None:
        """End soon, if it watches a way."""


T = TypeVar("T", bound=Counted)


@dataclass
class Device:
    read_ports: Callable[[], tuple[DevicePort, ...]]
    settings: DeviceSettings = field(default_factory=DeviceSettings)
    subscription: Subscribe = field(default_factory=lambda: Subscribe(0, 0, 0, 0))
    changed: Callable[[], None] = lambda: None  # called when more than counts may have changed
    alarmed: Callable[[], None] = lambda: None  # called at the alarm of a link monitor
    cut_off: Callable[[int | None], None] = lambda _us: None  # the memory; None: by its own default
    # Have the compensator look from now on at this interval; None: at its own.
    compensate: Callable[[int | None], None] = lambda _s: None
    _opened: list[Opened] = field(default_factory=list)
    _accepted: list[Counted] = field(default_factory=list)
    _serving: int = 0
    _ended: Counter[str] = field(default_factory=Counter)
    _in_use: dict[str, int] = field(default_factory=dict)
    _monitor: dict[str, int] = field(default_factory=dict)  # the last one, as DeviceReport names it
    _estimates: Estimates = field(default_factory=Estimates)

    @property
    def subscribed(self) -> bool:
        return self.subscription.period_ms > 0

    @property
    def at_work(self) -> bool:
        return bool(self._opened or self._accepted or self._serving)

    def set(self, settings: DeviceSettings) -> None:
        """Override what sessions use that begin from now on; SessionError if it cannot be had."""
        if settings.fec is not None and settings.fec not in CODES:
            raise unsupported(f"fec {settings.fec} is not known: choose one of {', '.join(NAMES)}")
        if settings.compensate_s != self.settings.compensate_s:
            self.compensate(settings.compensate_s)
        self.settings = settings
        self.cut_off(settings.cutoff_us)

    def override(self, setup: Setup) -> Setup:
        used = overridden(setup, self.settings)
        if used != setup:
            changes = [
                f"{name} {value} to {getattr(used, name)}"
                for name, value in vars(setup).items()
                if value != getattr(used, name)
            ]
            log.info("session %016x, overridden: %s", setup.session, ", ".join(changes))
        self._note(used)
        return used

    @contextmanager
    def opens(self, session: Opened) -> Iterator[None]:
        with self._counting(session, self._opened):
            yield

    def preempt(self, monitor: int) -> bool:
        """End a link monitor of this host between two blocks; return whether one was open."""
        monitors = [
            session
            for session in self._opened
            if session.setup.session == monitor and session.setup.service in MONITORS
        ]
        for session in monitors:
            session.preempt()
        return bool(monitors)

    @contextmanager
    def accepts(self, session: Counted) -> Iterator[None]:
        self._note(session.setup)
        with self._counting(session, self._accepted):
            yield

    @contextmanager
    def _counting(self, session: T, among: list[T]) -> Iterator[None]:
        among.append(session)
        self.changed()
        try:
            yield
        finally:
            among.remove(session)
            self._ended.update(session.counts)
            self._note_estimates(session, over=True)
            if session.watched is not None:
                self._monitor_over(session.setup.session, session.watched)
            self.changed()

    def _monitor_over(self, session: int, watched: Watched) -> None:
        figures = watched.compared, watched.errors, watched.tests, watched.ended
        names = "monitor_compared", "monitor_errors", "monitor_tests", "monitor_end"
        self._monitor |= {"monitor": session, **dict(zip(names, figures, strict=True))}
        if watched.alarm:
            self._monitor["alarm"] = session
            self.alarmed()

    @contextmanager
    def serves(self, setup: Setup) -> Iterator[None]:
        """Count a session that this host makes pairs for."""
        self._note(setup)
        self._serving += 1
        self.changed()
        try:
            yield
        finally:
            self._serving -= 1
            self.changed()

    def made(self, pairs: int) -> None:
        self._ended["pairs_made"] += pairs

    def report(self, session: int = 0) -> DeviceReport:
        """Return the state now, as the answer to a request or, with 0, unasked."""
        counts = self._ended.copy()
        for under_way in (*self._opened, *self._accepted):
            counts.update(under_way.counts)
        return DeviceReport(
            session,
            sending=len(self._opened),
            receiving=len(self._accepted),
            serving=self._serving,
            period_ms=self.subscription.period_ms,
            lost_ppm=self.subscription.lost_ppm,
            symbol_error_ppm=self.subscription.symbol_error_ppm,
            settings=self.settings,
            ports=self.read_ports(),
            **counts,
            **self._in_use,
            **self._monitor,
        )

    def new_estimates(self) -> list[SessionEstimate]:
        """Return what sessions have found out since this was asked last."""
        for session in (*self._opened, *self._accepted):
            self._note_estimates(session)
        return self._estimates.take()

    def _note_estimates(self, session: Counted, over: bool = False) -> None:
        estimates = estimates_of(session.summary, session.counts)
        self._estimates.note(session.setup.session, estimates, over)

    def alarming(self, before: DeviceReport, now: DeviceReport) -> bool:
        """Whether more was lost or wrong between two reports than the subscription puts up with."""
        lost = now.pairs_lost - before.pairs_lost
        errors = now.symbol_errors - before.symbol_errors
        pairs = now.pairs_sent - before.pairs_sent + now.pairs_received - before.pairs_received
        return _exceeds(lost, max(pairs, lost), self.subscription.lost_ppm) or _exceeds(
            errors, max(pairs - lost, errors), self.subscription.symbol_error_ppm
        )

    def _note(self, setup: Setup) -> None:
        names = "rate_hz", "frame_bytes", "fec", "interleave", "wavelength_pm"
        self._in_use = {name: getattr(setup, name) for name in names}


def changed(before: DeviceReport, now: DeviceReport) -> bool:
    return _facts(before) != _facts(now)


def _facts(report: DeviceReport) -> tuple[object, ...]:
    sessions = report.sending, report.receiving, report.serving
    subscription = report.period_ms, report.lost_ppm, report.symbol_error_ppm
    monitors = report.alarm, report.monitor
    return sessions, subscription, monitors, report.settings, report.ports


def _exceeds(part: int, whole: int, ppm: int) -> bool:
    return part > 0 and part * PARTS_PER_MILLION > whole * ppm
