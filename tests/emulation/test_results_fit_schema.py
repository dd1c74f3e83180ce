"""The result.json of whole runs is as its schema says."""

import json
from pathlib import Path

import pytest
from conftest import ROOT
from json_schema import problems
from limits import PROGRAM_S
from loaded import run_qmn

from qmn.scripting import start


def require_schema(folder: Path) -> None:
    """Fail unless the result in a folder fits."""
    root = json.loads((ROOT / "docs" / "result.schema.json").read_text())
    assert problems(json.loads((folder / "result.json").read_text()), root, root) == []


@pytest.mark.by_day(every=3)
@pytest.mark.parametrize(
    "words",
    [
        ("sdc", "--message", "two bits", "--metrics"),
        ("teleport", "--count", "100", "--captures", "none"),
        ("qkd", "--count", "20000", "--eve", "0.5", "--without", "events"),
        ("sdc", "--message", "x", "--loss-db-per-km", "1000", "--loss-budget-db", "1"),
    ],
    ids=lambda words: " ".join(words[:2]),
)
def test_a_run_of_any_kind_leaves_a_result_that_fits(
    tmp_path: Path, words: tuple[str, ...]
) -> None:
    run_qmn("run", *words, "--runs", str(tmp_path), timeout_s=PROGRAM_S)
    require_schema(tmp_path / "latest")


def test_a_network_of_a_script_leaves_a_result_that_fits(tmp_path: Path) -> None:
    with start("sdc", folder=tmp_path) as network:
        network.send("alice", "bob", b"two bits")
    require_schema(tmp_path)
