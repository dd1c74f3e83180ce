"""The time line of keys: what it shows is what happened."""

import re
from typing import Any

from applications.vpn.job import closed_s, hindrance
from views.report.key_timeline import key_timeline, spans
from wire.results.time_series import AnyMoment, SessionMoment, moment

STORE = {"peer": "bob", "opened": True, "mine": 8, "theirs": 8, "withheld": False}
SESSION = {"event": "session", **STORE, "keys": 4, "qber": 0.01}
ALARM = {"event": "alarm", **STORE, "keys": 0, "qber": 0.12}
OPENED, CLOSED = {"event": "tunnel_opened"}, {"event": "tunnel_closed", "key_age_s": 5.0}


def at(time_s: float, host: str, line: dict[str, Any]) -> AnyMoment:
    return moment({**line, "host": host}, time_s)


STORY = [
    at(0.5, "alice", SESSION),
    at(1.0, "bob", OPENED),
    at(1.1, "alice", OPENED),
    at(4.0, "alice", ALARM),
    at(6.0, "bob", CLOSED),
    at(6.5, "alice", CLOSED),
    at(8.0, "alice", SESSION),
    at(9.0, "bob", OPENED),
    at(9.25, "alice", OPENED),
    at(10.0, "alice", {"event": "received", "bytes": 5_000_000}),
]


def test_spans_are_from_event_to_event() -> None:
    bobs = [each for each in STORY if each.host == "bob"]
    assert spans(bobs, "tunnel_opened", "tunnel_closed", 10.0) == [(1.0, 6.0), (9.0, 10.0)]
    assert spans([], "tunnel_opened", "tunnel_closed", 10.0) == []


def test_the_tunnel_is_closed_while_it_is_at_either_end() -> None:
    assert closed_s(STORY, 10.0) == 9.25 - 6.0
    assert closed_s(STORY[:5], 10.0) == 10.0 - 6.0
    assert closed_s(STORY[:3], 10.0) == 0.0


def test_what_kept_a_file_is_why_the_last_session_failed_or_the_closed_tunnel() -> None:
    cut = {"event": "failed", **STORE, "keys": 0, "qber": None, "text": "fibre a is cut"}
    failed = [*STORY[:3], at(4.0, "alice", cut)]
    assert hindrance(failed, 10.0) == "no keys, as alice's last session failed: fibre a is cut"
    assert hindrance([*failed, at(5.0, "alice", SESSION)], 10.0).startswith("the tunnel was closed")
    assert hindrance(STORY, 10.0) == "the tunnel was closed for 3.2 s; give it more --seconds"


def test_rows_are_drawn_for_what_there_was() -> None:
    lines = re.findall(r">([^<>]+)</text>", key_timeline(STORY))
    assert {"QBER", "tunnel, keys", "file (MB)", "alice", "bob", "time (s)"} <= set(lines)
    sessions_alone = [each for each in STORY if isinstance(each, SessionMoment)]
    lines = re.findall(r">([^<>]+)</text>", key_timeline(sessions_alone))
    assert "QBER" in lines
    assert "file (MB)" not in lines
