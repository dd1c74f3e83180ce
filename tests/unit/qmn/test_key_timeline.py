"""The time line of keys: what it shows is what happened."""

import re

from qmn.jobs.vpn import closed_s
from qmn.reports.key_timeline import key_timeline, spans

SESSION = {"event": "session", "host": "alice", "opened": True, "keys": 4, "qber": 0.01}
ALARM = {"event": "alarm", "host": "alice", "opened": True, "keys": 0, "qber": 0.12}


def at(time_s: float, event: str, host: str) -> dict[str, object]:
    return {"at": time_s, "event": event, "host": host}


STORY = [
    {**SESSION, "at": 0.5},
    at(1.0, "tunnel_opened", "bob"),
    at(1.1, "tunnel_opened", "alice"),
    {**ALARM, "at": 4.0},
    at(6.0, "tunnel_closed", "bob"),
    at(6.5, "tunnel_closed", "alice"),
    {**SESSION, "at": 8.0},
    at(9.0, "tunnel_opened", "bob"),
    at(9.25, "tunnel_opened", "alice"),
    {"at": 10.0, "event": "received", "host": "alice", "bytes": 5_000_000},
]


def test_spans_are_from_event_to_event() -> None:
    bobs = [each for each in STORY if each.get("host") == "bob"]
    assert spans(bobs, "tunnel_opened", "tunnel_closed", 10.0) == [(1.0, 6.0), (9.0, 10.0)]
    assert spans([], "tunnel_opened", "tunnel_closed", 10.0) == []


def test_the_tunnel_is_closed_while_it_is_at_either_end() -> None:
    assert closed_s(STORY, 10.0) == 9.25 - 6.0
    assert closed_s(STORY[:5], 10.0) == 10.0 - 6.0
    assert closed_s(STORY[:3], 10.0) == 0.0


def test_rows_are_drawn_for_what_there_was() -> None:
    said = re.findall(r">([^<>]+)</text>", key_timeline(STORY))
    assert {"QBER", "tunnel, keys", "file (MB)", "alice", "bob", "time (s)"} <= set(said)
    sessions_alone = [each for each in STORY if "qber" in each]
    said = re.findall(r">([^<>]+)</text>", key_timeline(sessions_alone))
    assert "QBER" in said
    assert "file (MB)" not in said
