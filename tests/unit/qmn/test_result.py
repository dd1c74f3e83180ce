"""The facts of a run."""

import argparse
import json
from io import StringIO
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from qmn.jobs import superdense
from qmn.results.result import coding, complete, percentiles, show
from topologies.network import Signals
from topologies.record import RECORD, read_record


def test_percentiles_of_nothing_of_one_and_of_many() -> None:
    assert percentiles([]) == {"p50": None, "p99": None, "n": 0}
    assert percentiles([2.0]) == {"p50": 2.0, "p99": 2.0, "n": 1}
    many = percentiles([float(number) for number in range(101)])
    assert many == {"p50": 50.0, "p99": 99.0, "n": 101}


def begin(folder: Path, received: bytes | None) -> dict[str, Any]:
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


def test_rates_and_counts_come_from_sender_and_controller(tmp_path: Path) -> None:
    facts = begin(tmp_path, b"two bits")
    facts["sender"] = {
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
    facts["sender"] = {"elapsed_s": 1.0, "fec": 0, "interleave": 0, "code_rate": 1.0}
    complete(facts, tmp_path)
    assert coding(facts) == {}


def test_a_line_that_is_still_being_written_is_left_out(tmp_path: Path) -> None:
    (tmp_path / RECORD).write_text('{"event": "switch"}\n{"event": "fib')
    assert read_record(tmp_path) == [{"event": "switch"}]
    assert read_record(tmp_path / "nowhere") == []


def shown(folder: Path, **facts: Any) -> list[str]:
    """Return the lines that a person reads of a run with these facts."""
    known = begin(folder, facts.pop("received", b"two bits"))
    known["sender"] = {
        "bell_pairs": 12_345,
        "lost_pairs": 6_789,
        "received_symbols": 5_000,
        "symbol_errors": 20,
        "repeated_frames": 31,
        "elapsed_s": 2.0,
    }
    complete(known, folder)
    said: dict[str, Any] = {
        "backend": "chp",
        "exact": True,
        "events": False,
        "timeline": "t",
        "report": "r",
    }
    said["time_scale"] = 1.0
    text = StringIO()
    show(Console(file=text, width=200), {**known, **said, "captures": True, **facts}, folder)
    return [" ".join(line.split()) for line in text.getvalue().splitlines()]


def test_a_person_is_told_what_was_lost_and_what_was_missed(tmp_path: Path) -> None:
    lines = shown(tmp_path, packets_not_captured=4_321)
    assert {
        "message 8 bytes, delivered exactly",
        "Bell pairs used 12,345",
        "pairs lost 6,789",
        "symbol error rate 0.004",
        "repeated frames 31",
        "pairs/s 6,172 (2.00 s)",
        f"captures {tmp_path}/*.pcap, 4,321 packets missed",
    } <= set(lines)


@pytest.mark.parametrize("received", [None, b"two bit!", b"two bits "])
def test_a_person_is_told_what_was_not_delivered(tmp_path: Path, received: bytes | None) -> None:
    assert "message 8 bytes, NOT DELIVERED" in shown(tmp_path, received=received)


@pytest.mark.parametrize(("received", "status"), [(b"two bits", 0), (b"two bit!", 1), (None, 1)])
def test_the_status_is_that_of_the_bytes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, received: bytes | None, status: int
) -> None:
    """Whatever a network leaves behind: a real one does not leave wrong bytes."""

    def leave(arguments: Any, folder: Path, facts: dict[str, Any], *_others: Any) -> None:
        assert arguments.message == "two bits"
        facts["time_scale"] = 1.0
        if received is not None:
            (folder / "received").write_bytes(received)

    monkeypatch.setattr(superdense, "run_network", leave)
    monkeypatch.setattr(superdense, "require_root", lambda: None)
    parser = argparse.ArgumentParser()
    superdense.add_parsers(parser.add_subparsers())
    words = ["sdc", "--message", "two bits", "--runs", str(tmp_path / "runs")]
    text = StringIO()
    with Signals() as signals:
        console = Console(file=text, width=200)
        assert superdense.run(parser.parse_args(words), signals, console) == status
    assert ("delivered exactly" in text.getvalue()) == (status == 0)
    result = json.loads((tmp_path / "runs" / "latest" / "result.json").read_text())
    assert result["delivered"] is (status == 0)
