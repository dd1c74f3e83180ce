"""A start that takes long says what it waits for; a short one says nothing."""

import pytest

from topologies.networks.long_start import LongStart


def test_a_long_start_says_what_it_waits_for_every_five_seconds(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    now_s = 100.0
    monkeypatch.setattr("time.monotonic", lambda: now_s)
    lines: list[str] = []
    start = LongStart(lines.append)
    for now_s in (101.0, 104.9, 105.1, 106.0, 110.0, 110.2):
        start.waits_for(f"c0 at {now_s:g}")
    assert lines == [
        "still starting after 5 s: waiting for c0 at 105.1",
        "still starting after 10 s: waiting for c0 at 110.2",
    ]
