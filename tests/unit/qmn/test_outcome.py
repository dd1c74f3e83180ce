"""The outcome of a run, for a person, and for a program that asks for the status."""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from io import StringIO
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from netqasm.examples import apps
from recorded_run import message_run, sent, service_run, teleported
from rich.console import Console

from applications.keys import job as keys
from applications.netqasm import job as netqasm
from applications.vpn import job as vpn
from evidence.traffic import job as load
from hosts.middleware.services.superdense.options import SuperdenseOptions
from qmn.__main__ import described
from qmn.jobs import counted_service, runner, superdense
from qmn.jobs.run_context import RunContext
from qmn.jobs.transfer import TransferError
from qmn.network.options import NetworkOptions
from qmn.requests.run_options import RunOptions
from qmn.requests.superdense import SuperdenseRequest
from qmn.results.result import complete, show
from qmn.results.run_result import RunResult
from topologies.networks.network import Signals
from topologies.system.processes.programs import NetworkError
from wire.network_time import NetworkTime
from wire.results.figures import EveFigures, PairFigures, StoredKeyFigures, TunnelFigures
from wire.results.run_result import Approximated, ServiceJob


def shown(folder: Path, **facts: Any) -> list[str]:
    """Return the lines that a person reads of a run with these facts."""
    report = sent(
        2.0,
        bell_pairs=12_345,
        lost_pairs=6_789,
        received_symbols=5_000,
        symbol_errors=20,
        repeated_frames=31,
    )
    known = message_run(folder, facts.pop("received", b"two bits"), report)
    complete(known, folder)
    texts = {"exact": True, "events": False, "timeline": "t", "captures": ["s1-eth1.pcap"]}
    text = StringIO()
    show(Console(file=text, width=200), replace(known, **{**texts, **facts}), folder, "r")
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


PAIRS: dict[str, Any] = {"session": "0a", "pairs": 500, "emitted": 585, "sampled": 85}
PAIRS |= {"fidelity": 0.95, "fidelity_low": 0.93, "fidelity_high": 0.96, "attempts": 0}
PURIFIED = ["rounds of purification 3", "pairs compared 6", "pairs purified 2"]


@pytest.mark.parametrize(("rounds", "purified"), [((0, 0, 0), []), ((3, 6, 2), PURIFIED)])
def test_figures_have_words_units_and_intervals(
    tmp_path: Path, rounds: tuple[int, int, int], purified: list[str]
) -> None:
    """Counts of purification are there if there was any, names for programs never."""
    known = PAIRS | dict(zip(("rounds", "compared", "survived"), rounds, strict=True))
    known |= {"elapsed_s": 0.5, "pairs_per_s": 1_000.0}
    facts, text = service_run(PairFigures(**known), "distribute"), StringIO()
    facts.delivered = True
    show(Console(file=text, width=200), facts, tmp_path, "r")
    lines = [" ".join(line.split()) for line in text.getvalue().splitlines()]
    assert lines[: lines.index("pairs/s 1,000") + 1] == [
        "result 500 pairs of alice and bob, with fidelity 0.950 (0.930 to 0.960)",
        *["pairs 500", "pairs made 585", "pairs sampled 85", "fidelity 0.95 (0.93 to 0.96)"],
        *purified,
        *["duration (s) 0.5", "pairs/s 1,000"],
    ]


def test_a_person_is_told_what_an_eavesdropper_took_and_knows(tmp_path: Path) -> None:
    """Half of her bases are right, and in the others half of the bits come out wrong."""
    facts, text = service_run(teleported(), "bb84"), StringIO()
    taken: dict[str, Any] = {"photons": 1_000, "measured": 200}
    assert isinstance(facts.job, ServiceJob)
    facts.delivered, facts.job.eve = True, EveFigures(**taken)
    show(Console(file=text, width=200), facts, tmp_path, "r")
    assert "Eve measured 200 of 1,000 photons (20.0 %)" in text.getvalue()
    assert "she knows 10.0 % of the sifted bits, and makes 5.0 % of them wrong" in text.getvalue()


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


def test_a_person_is_told_why_weak_pulses_were_simulated_one_by_one(tmp_path: Path) -> None:
    lines = shown(tmp_path, drawn_for=["PolarizationDrift", "paths in q1"])
    assert "weak pulses simulated one by one, for PolarizationDrift, paths in q1" in lines
    assert not [line for line in shown(tmp_path) if line.startswith("weak pulses")]


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


JOBS = {
    "run sdc": runner,
    "run teleport": runner,
    "run qkd": runner,
    "run distribute": runner,
    "run keys --seconds 1": keys,
    "run vpn": vpn,
    "run load": load,
    f"netqasm {Path(apps.__file__).parent / 'teleport'}": netqasm,
}


def status_of(words: str, runs: Path) -> int:
    """Return the status of a command that writes into this folder of runs."""
    whole = [*words.split(), "--runs", str(runs), "--without", "report"]
    arguments = described(whole).parse_args(whole)
    status: int = arguments.call(arguments)
    return status


@pytest.fixture
def no_network(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let jobs begin where no network could be started."""
    for job in (superdense, counted_service, keys, vpn, load, netqasm):
        monkeypatch.setattr(job, "require_free", lambda _topo: None)
    monkeypatch.setattr(vpn, "require_installed", lambda *_: None)


@pytest.mark.parametrize(
    "fault", [NetworkError("q1 is broken"), TransferError("no light")], ids=str
)
@pytest.mark.parametrize("words", JOBS, ids=lambda words: words.split("/")[0])
@pytest.mark.usefixtures("no_network")
def test_a_job_whose_network_fails_has_status_1(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: str, fault: Exception
) -> None:
    @contextmanager
    def fails(*_: object) -> Iterator[None]:
        raise fault
        yield

    monkeypatch.setattr(JOBS[words], "running_network", fails)
    assert status_of(words, tmp_path) == 1
    result = json.loads((tmp_path / "latest" / "result.json").read_text())
    assert (result["delivered"], result["error"]) == (False, str(fault))


@pytest.mark.parametrize("words", ["run teleport", "run qkd", "run distribute", "run swap"])
@pytest.mark.parametrize("delivered", [True, False])
@pytest.mark.usefixtures("no_network")
def test_the_status_of_a_counted_service_says_whether_it_was_done(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: str, delivered: bool
) -> None:
    def leave(_job: object, _context: object, facts: RunResult, _kept: object) -> None:
        facts.delivered, facts.time_scale = delivered, 1.0

    monkeypatch.setattr(runner, "use_network", leave)
    assert status_of(words, tmp_path) == (0 if delivered else 1)


@pytest.mark.parametrize("made", [0, 1, 7])
@pytest.mark.usefixtures("no_network")
def test_the_status_of_the_keeping_of_keys_says_whether_there_were_any(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, made: int
) -> None:
    report = StoredKeyFigures(
        sessions=1,
        sessions_without_key=0,
        keys=made,
        keys_per_s=0.0,
        qber_lowest=None,
        qber_highest=None,
        elapsed_s=1.0,
    )
    managers = SimpleNamespace(programs={}, urls={}, authority=tmp_path)

    @contextmanager
    def running(_context: object, facts: RunResult) -> Iterator[Any]:
        facts.time_scale = 1.0
        runtime = SimpleNamespace(time=NetworkTime(1.0), clocks_ahead_s=dict)
        yield SimpleNamespace(runtime=runtime, check=lambda: None)

    monkeypatch.setattr(keys, "running_network", running)
    monkeypatch.setattr(keys, "start_key_managers", lambda *_: managers)
    monkeypatch.setattr("applications.keys.time_series.summary", lambda *_: report)
    assert status_of("run keys --seconds 1", tmp_path) == (0 if made else 1)


@pytest.mark.parametrize("intact", [True, False, None])
@pytest.mark.usefixtures("no_network")
def test_the_status_of_a_tunnel_says_whether_its_file_is_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, intact: bool | None
) -> None:
    @contextmanager
    def running(_context: object, facts: RunResult, _prepare: object) -> Iterator[None]:
        facts.time_scale = 1.0
        yield

    def leave(*given: Any) -> None:
        reports: dict[str, Any] = {"file_intact": intact, "elapsed_s": 1.0}
        reports |= {"received_bytes": 0, "keys_used": 2}
        if intact is not None:
            given[-1].asking = TunnelFigures(**reports)

    monkeypatch.setattr(vpn, "running_network", running)
    monkeypatch.setattr(vpn, "use_network", leave)
    assert status_of("run vpn", tmp_path) == (0 if intact else 1)


@pytest.mark.parametrize("answered", [True, False])
@pytest.mark.usefixtures("no_network")
def test_the_status_of_heavy_traffic_says_whether_all_sessions_were_answered(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, answered: bool
) -> None:
    def leave(*given: Any) -> None:
        given[-1].delivered = answered

    monkeypatch.setattr(load, "_drive", leave)
    monkeypatch.setattr("evidence.traffic.job_result.show", lambda *_: None)
    assert status_of("run load", tmp_path) == (0 if answered else 1)
