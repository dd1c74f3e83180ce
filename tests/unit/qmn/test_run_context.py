"""A run that fails: what it leaves and says."""

import json
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from qmn.jobs.run_context import ending, guarded
from qmn.results.schema import RunFacts
from topologies.network import Interrupted, Signals
from topologies.programs import NetworkError


@pytest.mark.parametrize(
    ("fault", "status", "words"),
    [
        (NetworkError("q1 is broken"), 1, "qmn: q1 is broken"),
        (Interrupted(15), 143, "qmn: interrupted by SIGTERM; everything is cleaned up"),
    ],
)
def test_a_run_that_fails_tells_why_and_where_its_report_is(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], fault: Exception, status: int, words: str
) -> None:
    def complete(facts: RunFacts, folder: Path) -> None:
        (folder / "result.json").write_text(json.dumps(facts))

    facts: Any = {}

    def work(_signals: Signals, _console: Console) -> int:
        with ending(tmp_path, facts, complete):
            raise fault

    assert guarded(work) == status
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.splitlines() == [words, f"report to look at: {facts['report']}"]
    assert json.loads((tmp_path / "result.json").read_text())["error"] == str(fault)
