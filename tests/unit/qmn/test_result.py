"""The facts of a run."""

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any, cast

import pytest
from recorded_run import asked, message_run, sent, service_run, teleported

from qmn.results import schema
from qmn.results.result import (
    complete,
    copies,
    note_controller,
    percentiles,
    sessions,
    watched_light,
)
from qmn.results.service_result import coding
from wire.controller_lines import RECORD, read_record
from wire.results.figures import LoadFigures
from wire.results.run_result import Sessions, SetUpTimes, SwitchCopies, WatchedLight


def test_percentiles_of_nothing_of_one_and_of_many() -> None:
    assert percentiles([]) == SetUpTimes(None, None, 0)
    assert percentiles([2.0]) == SetUpTimes(2.0, 2.0, 1)
    many = percentiles([float(number) for number in range(101)])
    assert many == SetUpTimes(50.0, 99.0, 101)


@pytest.mark.parametrize(
    ("received", "delivered"), [(b"two bits", True), (b"two bit!", False), (None, False)]
)
def test_delivered_means_that_the_bytes_are_the_same(
    tmp_path: Path, received: bytes | None, delivered: bool
) -> None:
    facts = message_run(tmp_path, received)
    complete(facts, tmp_path)
    assert facts.delivered is delivered
    left = json.loads((tmp_path / "result.json").read_text())
    again = schema.read_run(left)
    assert asdict(again) == asdict(facts)


def test_seals_are_counted_if_there_were_any() -> None:
    facts = service_run(service="distribute")
    note_controller(facts, [{"event": "stopped"}])
    assert facts.watched is None
    assert watched_light(None) == {}
    seal = {"event": "watched", "compared": 2000, "errors": 3, "end": "OK"}
    preempted = {**seal, "compared": 500, "errors": 0, "end": "BUSY"}
    alarm = {"event": "alarm", "watched": ["q3-q4", "q2-q3"], "closed": True}
    reports = {**alarm, "watched": ["q7-q8"], "closed": False}
    note_controller(facts, [seal, preempted, alarm, alarm, reports])
    assert facts.watched == WatchedLight(
        monitors=2, preempted=1, compared=2500, errors=3, alarms=3, closed=["q2-q3", "q3-q4"]
    )
    (row,) = watched_light(facts.watched).values()
    assert row == "2 over 2,500 pairs, 3 of them wrong, alarms: 3, closed: q2-q3 q3-q4"


def test_copies_at_switches_are_in_time_late_or_missing() -> None:
    assert copies([{"event": "granted"}]) is None
    granted = [
        {"event": "granted", "copies_ms": {"q1": 1.0, "q2": None}},
        {"event": "granted", "copies_ms": {"q1": -3.0, "q3": None}},
    ]
    late = {"event": "copy_late", "switch": "q3", "setup_ms": 80.0}
    seen = copies([*granted, late])
    assert seen == SwitchCopies(in_time=2, late=1, missing=1, p50_ms=1.0)
    assert str(seen) == "2 of 4 in time, median 1 ms after c0; late 1, missing 1"
    at_once = {**late, "setup_ms": 0.0}
    assert copies([*granted, at_once]) == SwitchCopies(3, 0, 1, 0.0)
    assert copies([{"event": "granted", "copies_ms": {"q1": None}}]) == SwitchCopies(0, 0, 1, None)


def test_rates_and_counts_come_from_sender_and_controller(tmp_path: Path) -> None:
    text = sent(
        2.0,
        bell_pairs=40,
        received_symbols=32,
        symbol_errors=8,
        lost_pairs=8,
        fec=3,
        interleave=1,
        corrected_symbols=7,
        code_rate=0.5,
    )
    facts = message_run(tmp_path, b"two bits", text)
    lines = [
        {"time_ns": 1, "event": "path_ready", "setup_ms": 3.0, "packet_in_count": 5},
        {"time_ns": 2, "event": "stopped", "packet_in_count": 9},
    ]
    (tmp_path / RECORD).write_text("".join(json.dumps(line) + "\n" for line in lines))
    complete(facts, tmp_path)
    assert facts.path_setup_ms == SetUpTimes(3.0, 3.0, 1)
    assert facts.packet_in_count == 9
    assert text.symbol_error_rate == 0.25
    assert text.pairs_per_s == 20.0
    assert (facts.elapsed_s, facts.emulation) == (2.0, {"elapsed_s": 2.0, "pairs_per_s": 20.0})
    assert coding(text) == {
        "code": "golay, interleaved, rate 0.500",
        "put right by it": "7 wrong symbols, 0 lost ones",
    }


def test_settings_of_a_result_are_those_of_its_network(tmp_path: Path) -> None:
    facts = service_run(service="distribute")
    facts.parameters = asked("distribute", {"receiver": "bob", "loss_budget_db": 3.0})
    facts.controller, facts.seed = "os-ken", 7
    facts.write(tmp_path)
    used = schema.read_left(tmp_path).settings
    assert (used.loss_budget_db, used.controller, used.seed) == (3.0, "os-ken", 7)
    assert (used.apps, used.openflow_port) == ((), 6653)


def test_sessions_are_counted_once_each_whatever_they_were_told() -> None:
    reports = [("granted", "a"), ("granted", "a"), ("refused", "b"), ("granted", "c")]
    reports += [("refused", "b"), ("torn_down", "a")]
    found = sessions([{"event": event, "session": session} for event, session in reports])
    assert found == Sessions(granted=2, refused=1, ids=["a", "c"])


def test_a_run_without_a_code_says_nothing_of_codes() -> None:
    assert coding(sent(fec=0, interleave=0, code_rate=1.0)) == {}


def test_a_line_that_is_still_being_written_is_left_out(tmp_path: Path) -> None:
    (tmp_path / RECORD).write_text('{"time_ns": 1, "event": "switch"}\n{"time_ns": 2, "ev')
    assert read_record(tmp_path) == [{"time_ns": 1, "event": "switch"}]
    assert read_record(tmp_path / "nowhere") == []


def test_rates_are_of_the_network_and_beside_them_of_the_emulation(tmp_path: Path) -> None:
    """The application tells of a fifth of a second in the network, which took two here."""
    text = sent(0.2, bell_pairs=40)
    facts = message_run(tmp_path, b"two bits", text, time_scale=10.0)
    complete(facts, tmp_path)
    assert (facts.elapsed_s, text.pairs_per_s) == (0.2, 200.0)
    assert facts.emulation == {"elapsed_s": 2.0, "pairs_per_s": 20.0}


def test_hosts_tell_the_time_of_the_network_which_took_longer_here(tmp_path: Path) -> None:
    facts = service_run(teleported(elapsed_s=0.5, states_per_s=800.0), "distribute")
    facts.time_scale = 4.0
    complete(facts, tmp_path)
    assert facts.elapsed_s == 0.5
    assert facts.emulation == {"elapsed_s": 2.0, "states_per_s": 200.0}


def test_a_job_that_tells_no_time_of_its_own_took_none_that_is_known(tmp_path: Path) -> None:
    facts = service_run(cast("Any", LoadFigures)(pairs_per_s=80.0), "distribute")
    facts.time_scale = 4.0
    complete(facts, tmp_path)
    assert (facts.elapsed_s, facts.emulation) == (None, {"pairs_per_s": 20.0})
