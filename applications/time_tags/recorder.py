"""Writes the clicks of each host's detectors as time tags while the network runs.

Of bob there are in the folder `bob.tags`, words of S-Fifteen's cards (words.py); `bob.parquet`,
time_ps and channel of each click by his clock; and `bob.truth.parquet`, the network's time of the
same clicks in the same order, and what has caused them.
"""

from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import BinaryIO

import numpy as np
import pyarrow as arrow
from numpy.typing import NDArray
from pyarrow import parquet

from applications.time_tags import words
from dispatcher.devices.detectors import ClickReport
from wire.config import DispatcherConfig
from wire.parameters.physics import Detectors

# By channel: of Z, X, Y, Z+X and Z-X two each, and of both arms of a Bell analyser. A word has room
# for four detectors; clicks of the others are in the Parquet files alone.
PATTERNS = np.array([1, 4, 2, 8, 0, 0, 0, 0, 0, 0, 1, 2, 4, 8], np.uint8)
LATEST_PS = 10_000_000  # by which a click may be before its pulse is due, but for its detector
SIGMAS = 8  # by which jitter may change a time
ROWS = 1 << 20  # of a group

TAG = np.dtype([("time_ps", "<i8"), ("channel", "u1")])
TRUTH = np.dtype(
    [
        ("time_ps", "<i8"),
        ("light", "?"),
        ("session", "<u8"),
        ("block", "<u4"),
        ("half", "u1"),
        ("slot", "<i8"),
        ("misread", "?"),
    ]
)
CLICK = np.dtype([("tag", TAG), ("truth", TRUTH)])
Clicks = NDArray[np.void]


class HostTags:
    """The files of one host, in the order of its clock."""

    def __init__(self, folder: Path, host: str, stack: ExitStack) -> None:
        self._words: BinaryIO = stack.enter_context((folder / f"{host}.tags").open("wb"))
        self._tables = {
            name: stack.enter_context(parquet.ParquetWriter(folder / file, _schema(kind)))
            for name, kind, file in (
                ("tag", TAG, f"{host}.parquet"),
                ("truth", TRUTH, f"{host}.truth.parquet"),
            )
        }
        self._waiting = np.zeros(0, CLICK)
        self._rows: list[Clicks] = []

    def add(self, clicks: Clicks, before_ps: int) -> None:
        """Take clicks; all tags before this time are written, as no others will be."""
        waiting = np.concatenate([self._waiting, clicks])
        waiting = waiting[np.argsort(waiting["tag"]["time_ps"], kind="stable")]
        count = int(waiting["tag"]["time_ps"].searchsorted(before_ps))
        self._write(waiting[:count])
        self._waiting = waiting[count:]

    def finish(self) -> None:
        self._write(self._waiting)
        self._group()

    def _write(self, clicks: Clicks) -> None:
        self._words.write(as_words(clicks["tag"]))
        self._rows.append(clicks)
        if sum(rows.size for rows in self._rows) >= ROWS:
            self._group()

    def _group(self) -> None:
        rows = np.concatenate([np.zeros(0, CLICK), *self._rows])
        self._rows = []
        for name, table in self._tables.items():
            values = rows[name]
            columns = {each: np.ascontiguousarray(values[each]) for each in table.schema.names}
            table.write_table(arrow.table(columns, schema=table.schema))


def _schema(kind: np.dtype[np.void]) -> arrow.Schema:
    assert kind.names is not None
    return arrow.schema([(name, arrow.from_numpy_dtype(kind[name])) for name in kind.names])


def as_words(tags: NDArray[np.void]) -> bytes:
    """Return tags in S-Fifteen's words: one for all detectors that click within a unit."""
    patterns = PATTERNS[tags["channel"]]
    there = patterns > 0
    units, patterns = tags["time_ps"][there] // words.UNIT_PS, patterns[there]
    if not units.size:
        return b""
    begins = np.flatnonzero(np.diff(units, prepend=units[0] - 1))
    return words.encode(units[begins], np.bitwise_or.reduceat(patterns, begins))


class Recorder:
    """The observer of a network's clicks."""

    def __init__(
        self, folder: Path, detectors: Mapping[str, Detectors], begin_ns: int, stack: ExitStack
    ) -> None:
        self._folder, self._detectors, self._stack = folder, detectors, stack
        self._begin_ns = begin_ns
        self.hosts: dict[str, HostTags] = {}

    def observe(self, report: ClickReport) -> None:
        if report.node not in self.hosts:
            self.hosts[report.node] = HostTags(self._folder, report.node, self._stack)
        device = self._detectors.get(report.node, Detectors())
        start_ps = (report.train.start_ns - self._begin_ns) * 1000
        clicks = clicks_of(report, device, start_ps)
        self.hosts[report.node].add(clicks, earliest_ps(device, start_ps))


def earliest_ps(device: Detectors, start_ps: int) -> int:
    """Return the earliest tag that light which begins then can have, by the host's clock."""
    early_ps = LATEST_PS + device.gate_s * 5e11 + SIGMAS * device.jitter_ps
    ahead_ps = (start_ps - early_ps) * (device.clock_skew_ppm * 1e-6) + device.clock_offset_s * 1e12
    return start_ps + int(ahead_ps - early_ps - SIGMAS * device.clock_jitter_ps)


def clicks_of(report: ClickReport, device: Detectors, start_ps: int) -> Clicks:
    """Return what a host's card and the simulation know of clicks, by the host's clock."""
    slots = np.append(report.slots, report.slots[report.both])
    since_ps = report.slots * (report.train.interval_ns * 1e3) + report.beyond_ps
    since_ps = np.append(since_ps, since_ps[report.both]) + offsets_ps(report, device)
    clicks = np.zeros(slots.size, CLICK)
    truth, tag = clicks["truth"], clicks["tag"]
    truth["session"], truth["block"], truth["half"] = report.block
    truth["time_ps"], truth["slot"] = start_ps + np.rint(since_ps).astype(np.int64), slots
    truth["light"] = ~np.append(report.lightless, report.lightless[report.both])
    # Where both click, the outcome is drawn: the tags have both, and no readout error.
    misread = (report.reported != report.bits) & ~report.both
    truth["misread"] = np.append(misread, np.zeros(slots.size - misread.size, bool))
    bits = np.where(report.both, 0, report.reported)
    channels = report.first_channels + bits
    tag["channel"] = np.append(channels, report.first_channels[report.both] + 1)
    ahead_ps = report.random.standard_normal(slots.size) * device.clock_jitter_ps
    ahead_ps += (start_ps + since_ps) * (device.clock_skew_ppm * 1e-6)
    ahead_ps += device.clock_offset_s * 1e12
    tag["time_ps"] = start_ps + np.rint(since_ps + ahead_ps).astype(np.int64)
    return clicks


def offsets_ps(report: ClickReport, device: Detectors) -> NDArray[np.float64]:
    """Draw when in its gate each click comes, those of both detectors behind the others.

    Light is as late as it is, and by a jitter with which it is in the gate all the same; what has
    come from the gate of another pulse, and clicks without light, at any time in it.
    """
    late_ps = np.zeros(report.slots.size) if report.late_ps is None else report.late_ps
    late_ps = np.append(late_ps, late_ps[report.both])
    light = ~np.append(report.lightless, report.lightless[report.both])
    random, half_ps, jitter_ps = report.random, device.gate_s * 5e11, device.jitter_ps
    result = random.uniform(-half_ps, half_ps, late_ps.size)
    if not report.timed:
        return np.where(light, late_ps + random.standard_normal(late_ps.size) * jitter_ps, result)
    left = np.flatnonzero(light & (np.abs(late_ps) <= half_ps))
    while left.size:
        mean = late_ps[left]
        if jitter_ps <= half_ps:
            drawn = mean + random.standard_normal(left.size) * jitter_ps
            inside = np.abs(drawn) <= half_ps
        else:  # most of a wide normal distribution is outside
            drawn = random.uniform(-half_ps, half_ps, left.size)
            inside = random.random(left.size) < np.exp(-(((drawn - mean) / jitter_ps) ** 2) / 2)
        result[left[inside]] = drawn[inside]
        left = left[~inside]
    return result


@contextmanager
def begin(config: DispatcherConfig, begin_ns: int) -> Iterator[Recorder]:
    """Record into the folder of the configuration; its times begin here."""
    folder = Path(config.tags)
    folder.mkdir(mode=0o700)
    detectors = {name: device.detectors for name, device in config.devices.items()}
    with ExitStack() as stack:
        recorder = Recorder(folder, detectors, begin_ns, stack)
        try:
            yield recorder
        finally:
            for tags in recorder.hosts.values():
                tags.finish()
