"""Where a live view's messages come from: a network that runs, or the folder of a run."""

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Any

from qmn.running.controller_console import NoAnswer, ask
from qmn.timeouts import LIVE_DEVICES_S, LIVE_LINES_S, LIVE_PAUSE_MS
from topologies.system.processes.programs import NetworkError
from topologies.system.runs.runtime import EVENT_CAPTURE
from views.events.event_sources import gathered, recorded
from views.key_links import key_links
from views.live.acts import ACTS
from views.live.timeline import Timeline
from views.report.run_facts import SENDER_LOG
from wire.config import DispatcherConfig
from wire.controller_lines import RECORD, read_record
from wire.dispatcher_pb2 import WatchRequest
from wire.events import to_fields
from wire.results.time_series import fields_of

Clock = Callable[[], int]  # nanoseconds, as events are stamped
EVENT, CONTROLLER, ACT, DEVICES, JOB, FAULT = (
    "event",
    "controller",
    "act",
    "devices",
    "job",
    "fault",
)


def _shown(fields: dict[str, Any]) -> dict[str, Any]:
    """Return fields without their time, which a message has once."""
    return {name: value for name, value in fields.items() if name not in ("time", "time_ns")}


def timeline_of_run(folder: Path, scale: float = 1.0) -> Timeline:
    """Return all that a run has left, in the order of time; its origin is its first session."""
    capture = folder / EVENT_CAPTURE
    events = recorded(capture, follow=False) if capture.exists() else ()
    entries: list[tuple[int, str, dict[str, Any]]] = [
        (event.time_ns, EVENT, to_fields(event)) for event in events if not event.photon
    ]
    for what, facts in ((CONTROLLER, read_record(folder)), (ACT, read_acts(folder))):
        entries += [(fact["time_ns"], what, _shown(fact)) for fact in facts]
    entries.sort(key=lambda each: each[0])
    # Facts of the start of the network, which come before, are at the beginning.
    begin_ns = next((each[0] for each in entries if each[1] == EVENT or "session" in each[2]), None)
    entries += _reported(folder, begin_ns or 0, entries[-1][0] if entries else 0, scale)
    entries.sort(key=lambda each: each[0])
    timeline = Timeline(begin_ns or (entries[0][0] if entries else 0))
    for time_ns, what, fields in entries:
        timeline.add(what, time_ns, fields)
    timeline.end()
    return timeline


def _reported(
    folder: Path, begin_ns: int, last_ns: int, scale: float
) -> Iterator[tuple[int, str, dict[str, Any]]]:
    """Yield lines of the job's program by their time in its session; those without one: last."""
    for fields in filter(None, map(fields_of, read_lines(folder / SENDER_LOG))):
        elapsed_s = fields.get("elapsed_s")
        timed = isinstance(elapsed_s, int | float) and fields.get("event") == "result"
        at_ns = begin_ns + round(elapsed_s * scale * 1e9) if timed and elapsed_s else last_ns
        yield min(at_ns, last_ns), JOB, fields


def read_acts(folder: Path) -> list[dict[str, Any]]:
    acts = map(fields_of, read_lines(folder / ACTS))
    return [act for act in acts if isinstance(act.get("time_ns"), int)]


def read_lines(file: Path) -> list[bytes]:
    return file.read_bytes().splitlines() if file.exists() else []


@contextmanager
def following(timeline: Timeline, config: DispatcherConfig, folder: Path) -> Iterator[None]:
    """Append what happens in the network that runs, until it ends or nobody looks any more."""
    over, now_ns = threading.Event(), config.time.stamp_ns
    followers = (
        lambda: _follow_events(timeline, config),
        lambda: _follow_lines(timeline, CONTROLLER, folder / RECORD, now_ns, over),
        lambda: _follow_lines(timeline, JOB, folder / SENDER_LOG, now_ns, over),
        lambda: _follow_devices(timeline, now_ns, over),
    )
    # Daemons: a thread that reads from the dispatcher has no way to be ended.
    threads = [threading.Thread(target=follower, daemon=True) for follower in followers]
    for thread in threads:
        thread.start()
    try:
        yield
    finally:
        over.set()


def _follow_events(timeline: Timeline, config: DispatcherConfig) -> None:
    try:
        for events in gathered(config, WatchRequest(history=True, pause_ms=LIVE_PAUSE_MS)):
            timeline.add_events(EVENT, events)
    except NetworkError as error:
        timeline.add(FAULT, config.time.stamp_ns(), {"text": str(error)})
    timeline.end()


def _follow_lines(
    timeline: Timeline, what: str, file: Path, now_ns: Clock, over: threading.Event
) -> None:
    """Append the objects of a file, one a line, as they are written; it may not be there yet."""
    place, begun = 0, b""
    while not over.is_set() and not timeline.ended:
        if file.exists():
            with file.open("rb") as opened:
                opened.seek(place)
                new = opened.read()
            place += len(new)
            *lines, begun = (begun + new).split(b"\n")
            for fields in map(fields_of, lines):
                if fields:
                    timeline.add(what, fields.get("time_ns", now_ns()), _shown(fields))
        over.wait(LIVE_LINES_S)


def _follow_devices(timeline: Timeline, now_ns: Clock, over: threading.Event) -> None:
    """Add the controller's devices and sessions to the timeline when they change."""
    last: dict[str, Any] = {}
    while not over.is_set() and not timeline.ended:
        try:
            now = {
                "devices": ask("devices"),
                "sessions": ask("sessions"),
                "key_links": _key_links(),
            }
        except NoAnswer:
            now = {}  # it starts, or has ended, of which the dispatcher tells
        state = {name: [_still(each) for each in values] for name, values in now.items()}
        if state and state != last:
            last = state
            timeline.add(DEVICES, now_ns(), now)
        over.wait(LIVE_DEVICES_S)


def _key_links() -> list[dict[str, Any]]:
    try:
        nodes = ask("keys")["qkd_nodes"]
    except NoAnswer:
        return []  # without the package of key managers
    return [asdict(link) for link in key_links(nodes)]


def _still(fields: dict[str, Any]) -> dict[str, Any]:
    """Return fields without those that go on by themselves."""
    return {
        name: value for name, value in fields.items() if name not in ("heard_s_ago", "silent_s")
    }
