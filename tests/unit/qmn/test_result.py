"""The facts of a run."""

import json
from pathlib import Path
from typing import Any

import pytest

from qmn.results.message_result import coding
from qmn.results.result import (
    complete,
    emulation,
    note_controller,
    percentiles,
    watched_light,
)
from wire.controller_lines import RECORD, read_record


def test_percentiles_of_nothing_of_one_and_of_many() -> None:
    assert percentiles([]) == {"p50": None, "p99": None, "n": 0}
    assert percentiles([2.0]) == {"p50": 2.0, "p99": 2.0, "n": 1}
    many = percentiles([float(number) for number in range(101)])
    assert many == {"p50": 50.0, "p99": 99.0, "n": 101}


def begin(folder: Path, received: bytes | None) -> Any:
    (folder / "message").write_bytes(b"two bits")
    if received is not None:
        (folder / "received").write_bytes(received)
    return {"file": str(folder / "message")}


@pytest.mark.parametrize(
    ("received", "delivered"), [(b"two bits", True), (b"two bit!", False), (None, False)]
)
def test_delivered_means_that_the_bytes_are_the_same(
    tmp_path: Path, received: bytes | None, delivered: bool
) -> None:
    facts = begin(tmp_path, received)
    complete(facts, tmp_path)
    assert facts["delivered"] is delivered
    assert json.loads((tmp_path / "result.json").read_text()) == facts


def test_seals_are_counted_if_there_were_any() -> None:
    facts: Any = {}
    note_controller(facts, [{"event": "stopped"}])
    assert "watched" not in facts
    assert watched_light(facts) == {}
    seal = {"event": "watched", "compared": 2000, "errors": 3, "end": "OK"}
    given_back = {**seal, "compared": 500, "errors": 0, "end": "BUSY"}
    alarm = {"event": "alarm", "watched": ["q3-q4", "q2-q3"], "closed": True}
    told = {**alarm, "watched": ["q7-q8"], "closed": False}
    note_controller(facts, [seal, given_back, alarm, alarm, told])
    assert facts["watched"] == {
        "seals": 2,
        "given_back": 1,
        "compared": 2500,
        "errors": 3,
        "alarms": 3,
        "closed": ["q2-q3", "q3-q4"],
    }
    (row,) = watched_light(facts).values()
    assert row == "2 over 2,500 pairs, 3 of them wrong, alarms: 3, closed: q2-q3 q3-q4"


def test_rates_and_counts_come_from_sender_and_controller(tmp_path: Path) -> None:
    facts = begin(tmp_path, b"two bits")
    facts["asking"] = {
        "bell_pairs": 40,
        "received_symbols": 32,
        "symbol_errors": 8,
        "lost_pairs": 8,
        "repeated_frames": 1,
        "elapsed_s": 2.0,
        "fec": 3,
        "interleave": 1,
        "corrected_symbols": 7,
        "code_rate": 0.5,
        "symbols": 3,
    }
    lines = [
        {"event": "path_ready", "setup_ms": 3.0, "packet_in_count": 5},
        {"event": "stopped", "packet_in_count": 9},
    ]
    (tmp_path / RECORD).write_text("".join(json.dumps(line) + "\n" for line in lines))
    complete(facts, tmp_path)
    assert facts["symbol_error_rate"] == 0.25
    assert facts["pairs_per_s"] == 20.0
    assert facts["path_setup_ms"] == {"p50": 3.0, "p99": 3.0, "n": 1}
    assert facts["packet_in_count"] == 9
    assert facts["in_use"] == {"fec": "golay", "interleave": "on"}
    assert (facts["corrected_symbols"], facts["filled_symbols"]) == (7, 0)
    assert (facts["code_rate"], facts["bell_states"]) == (0.5, 3)
    assert coding(facts) == {
        "code": "golay, interleaved, rate 0.500",
        "put right by it": "7 wrong symbols, 0 lost ones",
    }


def test_a_run_without_a_code_says_nothing_of_codes(tmp_path: Path) -> None:
    facts = begin(tmp_path, b"two bits")
    facts["asking"] = {"elapsed_s": 1.0, "fec": 0, "interleave": 0, "code_rate": 1.0}
    complete(facts, tmp_path)
    assert coding(facts) == {}


def test_a_line_that_is_still_being_written_is_left_out(tmp_path: Path) -> None:
    (tmp_path / RECORD).write_text('{"event": "switch"}\n{"event": "fib')
    assert read_record(tmp_path) == [{"event": "switch"}]
    assert read_record(tmp_path / "nowhere") == []


def test_rates_are_of_the_network_and_beside_them_of_the_emulation(tmp_path: Path) -> None:
    """The application measures two seconds here, which are a fifth of one in the network."""
    facts: Any = {**begin(tmp_path, b"two bits"), "time_scale": 10.0}
    facts["asking"] = {"bell_pairs": 40, "elapsed_s": 2.0}
    complete(facts, tmp_path)
    assert (facts["elapsed_s"], facts["pairs_per_s"]) == (0.2, 200.0)
    assert facts["emulation"] == {"elapsed_s": 2.0, "pairs_per_s": 20.0}


def test_hosts_tell_the_time_of_the_network_which_took_longer_here() -> None:
    told = {"elapsed_s": 0.5, "key_bits_per_s": 800.0, "keys": 3, "qber": 0.1}
    facts: Any = {"time_scale": 4.0}
    assert emulation(told, facts) == {"elapsed_s": 2.0, "key_bits_per_s": 200.0}
