"""A run that fails: what it leaves and says."""

import json
from collections.abc import Callable
from functools import partial
from pathlib import Path

import pytest
from recorded_run import NETWORK, service_run
from rich.console import Console

from qmn.jobs.run_context import ending, guarded
from qmn.reports.run_facts import BadRun, read_result
from qmn.results.run_result import RunResult
from topologies.networks.network import Interrupted, Signals
from topologies.system.processes.programs import NetworkError

FAULTS = pytest.mark.parametrize(
    ("make", "status", "words"),  # made anew: notes stay with an error
    [
        (partial(NetworkError, "q1 is broken"), 1, "qmn: q1 is broken"),
        (partial(Interrupted, 15), 143, "qmn: interrupted by SIGTERM"),
    ],
)


def failed(folder: Path, facts: RunResult, fault: Exception) -> tuple[int, str]:
    """Return the status of a run that a fault has ended when so much was known, and its report."""
    left = []

    def work(_signals: Signals, _console: Console) -> int:
        with ending(folder, facts, RunResult.write) as ended:
            left.append(ended)
            raise fault

    return guarded(work), left[0].report


@FAULTS
def test_a_run_that_fails_tells_why_and_where_its_report_is(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    make: Callable[[], Exception],
    status: int,
    words: str,
) -> None:
    fault = make()
    facts = service_run()
    facts.network = NETWORK
    found, report = failed(tmp_path, facts, fault)
    assert found == status
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.splitlines() == [words, f"report to look at: {report}"]
    assert json.loads((tmp_path / "result.json").read_text())["error"] == str(fault)


@FAULTS
def test_a_run_whose_network_had_not_started_names_no_report(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    make: Callable[[], Exception],
    status: int,
    words: str,
) -> None:
    fault = make()
    found, report = failed(tmp_path, service_run(), fault)
    assert found == status
    assert capsys.readouterr().err.splitlines() == [words]
    assert report == "not made: the network had not started"
    with pytest.raises(BadRun, match=f"of {tmp_path} had not started: {fault}$"):
        read_result(tmp_path)
