"""Faults that `make chaos` finds: the runs that were struck are made up here."""

from pathlib import Path

import pytest
from jobs import keys_differ
from leaps import Span, wrong_leaps
from outcomes import Made, Outcome, bad, describe, first_report, too_few
from strikes import Strike
from under_way import Moment

from applications.keys.time_series import words
from wire.results.time_series import moment

KEYS = {"peer": "bob", "opened": True, "qber": None, "mine": 0, "theirs": 0, "withheld": True}
KILLED_BOB = Strike("bob", "SIGKILL", ("bob",))
KILLED_C0 = Strike("c0", "SIGTERM", ("c0",))
CUT = Strike("fibre q1-eth2", "down", ())


def outcome(cause: str, *strikes: tuple[Strike, float], at_s: float = 2.0) -> Outcome:
    """Return what a run says that was struck at such times and has named a cause."""
    made = [Made(strike, "session", after_s) for strike, after_s in strikes]
    return Outcome(1, "sdc", Moment("session", 0.5), made, 1, cause, at_s)


def test_a_run_that_names_what_was_struck_is_right() -> None:
    assert not bad(outcome("qmn: bob died in mid-run: signal 9", (KILLED_BOB, 0.0)))


def test_a_run_that_blames_another_is_wrong_and_says_so() -> None:
    found = outcome("qmn: dispatcher died in mid-run", (KILLED_BOB, 0.0))
    assert bad(found)
    assert "ANOTHER NAMED" in describe(found)


def test_of_several_strikes_any_may_be_named() -> None:
    struck = (KILLED_BOB, 0.0), (KILLED_C0, 0.5)
    for cause in ("qmn: bob died in mid-run", "qmn: c0 died in mid-run"):
        assert not bad(outcome(cause, *struck))
    assert bad(outcome("qmn: dispatcher died in mid-run", *struck))


def test_a_strike_after_the_cause_was_named_is_not_it() -> None:
    assert bad(outcome("qmn: c0 died in mid-run", (KILLED_BOB, 0.0), (KILLED_C0, 3.0)))


def test_a_strike_with_no_name_of_its_own_may_be_what_any_cause_is_of() -> None:
    """Without light a session ends for reasons of its own."""
    cut = outcome("qmn: no light path from alice to bob", (CUT, 0.0), at_s=4.0)
    assert not bad(cut)
    assert not bad(outcome(cut.cause, (KILLED_BOB, 0.0), (CUT, 0.1)))


def test_a_cut_fibre_is_named_when_the_run_tells_of_it_and_not_when_it_ends() -> None:
    lines = [(1.0, "no light: fibre a is cut"), (2.0, "no light: fibre b is cut"), (12.0, "ending")]
    cause = "ending: no light for 10 s: fibre b is cut"
    assert first_report(lines, cause, ended=12.0) == 2.0
    assert first_report(lines, "ending: bob died in mid-run", ended=12.0) == 12.0
    assert bad(outcome(cause, (CUT, 0.5), at_s=12.0))
    assert not bad(outcome(cause, (CUT, 0.5), at_s=2.0))


def test_what_a_session_for_keys_failed_by_is_told_before_the_run_ends() -> None:
    why = "no light path from alice to bob: fibre alice-q1 (alice-q0) is cut"
    line = words(moment({"event": "failed", "host": "alice", "keys": 0, "text": why, **KEYS}, 1.0))
    cause = (
        f"ending: the file was not there in 60 s: no keys, as alice's last session failed: {why}"
    )
    assert first_report([(2.0, line), (60.0, cause)], cause, ended=60.0) == 2.0
    assert first_report([(2.0, line)], "ending: bob died in mid-run", ended=60.0) == 60.0


def test_fewer_strikes_than_were_asked_for_are_a_fault() -> None:
    assert too_few(7, 12, 0.5).endswith("7 of 12 strikes in 0.5 minutes: allow more --minutes")
    assert too_few(12, 12, 0.5) == too_few(13, 12, 0.5) == too_few(0, None, 0.5) == ""


@pytest.mark.parametrize(
    ("theirs", "faults"),
    [
        ({"a": b"1", "b": b"2"}, []),
        ({"a": b"1"}, []),  # the other host was struck before it kept the second
        ({"a": b"3"}, ["key a differs"]),
        ({}, ["delivered, but no key is kept by two hosts"]),
    ],
)
def test_keys_are_compared_by_id_whoever_hands_them_out_first(
    tmp_path: Path, theirs: dict[str, bytes], faults: list[str]
) -> None:
    stores = {"alice/bob/first": {"a": b"1", "b": b"2"}, "bob/alice/second": theirs}
    for store, keys in stores.items():
        (tmp_path / store).mkdir(parents=True)
        for name, key in keys.items():
            (tmp_path / store / name).write_bytes(key)
    assert keys_differ(tmp_path, 0) == faults


@pytest.mark.parametrize(
    ("spans", "wrong"),
    [
        ([], 0),
        ([(10, 20)], 1),  # one leap brought the clock from the first instant to the other
        ([(10, 30)], 2),
        ([(10, 20), (10, 30)], 2),  # two parties had work at the first of the same two leaps
        ([(10, 20), (30, 40)], 2),
        ([(12, 18)], 1),  # the clock went on, but no leap was recorded
    ],
)
def test_leaps_within_spans_in_which_time_should_have_stood_are_wrong(
    spans: list[Span], wrong: int
) -> None:
    assert wrong_leaps([10, 20, 30, 40], spans) == wrong
