"""A run that fails: what it leaves and says."""

import json
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from qmn.jobs.run_context import ending, guarded
from qmn.reports.run_facts import BadRun, read_result
from qmn.results.schema import RunFacts
from topologies.networks.network import Interrupted, Signals
from topologies.system.processes.programs import NetworkError

FAULTS = pytest.mark.parametrize(
    ("make", "status", "words"),  # made anew: notes stay with an error
    [
        (partial(NetworkError, "q1 is broken"), 1, "qmn: q1 is broken"),
        (partial(Interrupted, 15), 143, "qmn: interrupted by SIGTERM; everything is cleaned up"),
    ],
)


def failed(folder: Path, facts: Any, fault: Exception) -> int:
    """Return the status of a run that a fault has ended when so much was known of it."""

    def complete(facts: RunFacts, folder: Path) -> None:
        (folder / "result.json").write_text(json.dumps(facts))

    def work(_signals: Signals, _console: Console) -> int:
        with ending(folder, facts, complete):
            raise fault

    return guarded(work)


@FAULTS
def test_a_run_that_fails_tells_why_and_where_its_report_is(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    make: Callable[[], Exception],
    status: int,
    words: str,
) -> None:
    fault = make()
    facts: Any = {"network": {"hosts": []}}
    assert failed(tmp_path, facts, fault) == status
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.splitlines() == [words, f"report to look at: {facts['report']}"]
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
    facts: Any = {}
    assert failed(tmp_path, facts, fault) == status
    assert capsys.readouterr().err.splitlines() == [words]
    assert facts["report"] == "not made: the network had not started"
    with pytest.raises(BadRun, match=f"of {tmp_path} had not started: {fault}$"):
        read_result(tmp_path)
