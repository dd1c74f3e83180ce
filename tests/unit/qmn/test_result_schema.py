"""result.json has one schema, which docs/ has as a file."""

import json
from pathlib import Path
from typing import Any

import pytest
from json_schema import problems
from recorded_run import record_run, service_run

from qmn.results.result import complete
from topologies.system.processes.programs import ROOT
from wire.results import schema

FILE = ROOT / "docs" / "result.schema.json"


def wrong(result: dict[str, Any]) -> list[str]:
    """Return what of a result does not fit the schema in docs/."""
    root = json.loads(FILE.read_text())
    return problems(result, root, root)


def of_message(folder: Path) -> dict[str, Any]:
    """Return the result of a recorded run, whatever is known only of a network that has run."""
    result: dict[str, Any] = json.loads((record_run(folder) / "result.json").read_text())
    return result


def test_the_schema_in_docs_is_that_of_the_code() -> None:
    """Made anew by: python -m wire.results.schema > docs/result.schema.json."""
    assert FILE.read_text() == schema.text()


def test_the_result_of_a_message_fits(tmp_path: Path) -> None:
    assert wrong(of_message(tmp_path)) == []


def test_the_result_of_a_service_fits(tmp_path: Path) -> None:
    told = {"event": "done", "states": 7, "arrived": 7, "fidelity": 1.0, "elapsed_s": 2.0}
    complete(service_run(**told), tmp_path)
    assert wrong(json.loads((tmp_path / "result.json").read_text())) == []


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"pairs_made": 7.5}, "/pairs_made: 7.5 is not of type integer"),
        ({"delivered": 1}, "/delivered: 1 is not of type boolean"),
        ({"sessions": {"granted": 1, "refused": 0, "ids": [7]}}, "/sessions/ids/0: 7 is not"),
        ({"pair_made": 7}, "/pair_made is unknown"),
        ({"job": {"asking": {}, "asked": {}}}, "/job/eve is missing"),
        ({"path_setup_ms": {"p50": 1.0, "n": 1}}, "/path_setup_ms/p99 is missing"),
    ],
)
def test_what_does_not_fit_is_noticed(tmp_path: Path, change: dict[str, Any], text: str) -> None:
    (found,) = wrong({**of_message(tmp_path), **change})
    assert text in found


def test_a_result_without_what_every_run_says_does_not_fit(tmp_path: Path) -> None:
    result = of_message(tmp_path)
    for name in ("seed", "service", "backend", "emulation"):
        assert wrong({each: value for each, value in result.items() if each != name})
