"""The outcome of a run, as a person is told, and a program that asks for the status."""

import json
from dataclasses import replace
from io import StringIO
from pathlib import Path
from typing import Any

import pytest
from recorded_run import message_run, sent
from rich.console import Console

from hosts.middleware.services.superdense.options import SuperdenseOptions
from qmn.jobs import runner, superdense
from qmn.jobs.run_context import RunContext
from qmn.network.options import NetworkOptions
from qmn.requests.run_options import RunOptions
from qmn.requests.superdense import SuperdenseRequest
from qmn.results.result import complete, show
from qmn.results.run_result import RunResult
from topologies.networks.network import Signals
from wire.results.run_result import Approximated, ServiceJob


def shown(folder: Path, **facts: Any) -> list[str]:
    """Return the lines that a person reads of a run with these facts."""
    told = sent(
        2.0,
        bell_pairs=12_345,
        lost_pairs=6_789,
        received_symbols=5_000,
        symbol_errors=20,
        repeated_frames=31,
    )
    known = message_run(folder, facts.pop("received", b"two bits"), told)
    complete(known, folder)
    said = {"exact": True, "events": False, "timeline": "t", "captures": ["s1-eth1.pcap"]}
    text = StringIO()
    show(Console(file=text, width=200), replace(known, **{**said, **facts}), folder, "r")
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


def test_a_person_is_told_what_is_approximated_and_by_how_much(tmp_path: Path) -> None:
    met = [Approximated("one thing", 0.19471), Approximated("another", 0.5)]
    words = "one thing: a probability is wrong by 0.19 at most; another: a probability "
    words += "is wrong by 0.5 at most"
    lines = shown(tmp_path, exact=False, approximations=met)
    assert {"quantum states chp, with approximations", f"approximated {words}"} <= set(lines)
    assert not [line for line in shown(tmp_path) if line.startswith("approximated")]


def test_a_person_is_told_what_was_lost_while_it_waited(tmp_path: Path) -> None:
    (line,) = [
        line
        for line in shown(tmp_path, photons_lost_waiting=46_991)
        if line.startswith("lost in delay lines")
    ]
    assert "46,991 photons" in line
    assert "analyser.delay_line_db_per_km" in line
    assert not [line for line in shown(tmp_path) if line.startswith("lost in delay lines")]


@pytest.mark.parametrize("received", [None, b"two bit!", b"two bits "])
def test_a_person_is_told_what_was_not_delivered(tmp_path: Path, received: bytes | None) -> None:
    assert "message 8 bytes, NOT DELIVERED" in shown(tmp_path, received=received)


@pytest.mark.parametrize(("received", "status"), [(b"two bits", 0), (b"two bit!", 1), (None, 1)])
def test_the_status_is_that_of_the_bytes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, received: bytes | None, status: int
) -> None:
    """Whatever a network leaves behind: a real one does not leave wrong bytes."""

    def leave(job: runner.Job, context: RunContext, facts: RunResult, _kept: ServiceJob) -> None:
        assert job.file
        assert job.file.read_bytes() == b"two bits"
        facts.time_scale = 1.0
        if received is not None:
            (context.folder / "received").write_bytes(received)

    monkeypatch.setattr(runner, "use_network", leave)
    monkeypatch.setattr(superdense, "require_free", lambda _topo: None)
    request = SuperdenseRequest(
        message="two bits",
        options=SuperdenseOptions("bob", 7),
        network=NetworkOptions(topology="sdc"),
        run=RunOptions(runs=tmp_path / "runs"),
    )
    text = StringIO()
    with Signals() as signals:
        console = Console(file=text, width=200)
        assert superdense.run(request, signals, console) == status
    assert ("delivered exactly" in text.getvalue()) == (status == 0)
    result = json.loads((tmp_path / "runs" / "latest" / "result.json").read_text())
    assert result["delivered"] is (status == 0)
