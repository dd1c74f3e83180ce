"""The result.json of whole runs is as its schema says: tests of each kind of run look, too."""

import json
from pathlib import Path

from conftest import ROOT
from json_schema import problems
from limits import PROGRAM_S
from loaded import run_qmn


def require_schema(folder: Path) -> None:
    """Fail unless the result in a folder fits."""
    root = json.loads((ROOT / "docs" / "result.schema.json").read_text())
    assert problems(json.loads((folder / "result.json").read_text()), root, root) == []


def test_a_run_that_fails_leaves_a_result_that_fits(tmp_path: Path) -> None:
    words = ("--message", "x", "--loss-db-per-km", "1000", "--loss-budget-db", "1")
    done = run_qmn("run", "sdc", *words, "--runs", str(tmp_path), timeout_s=PROGRAM_S)
    assert done.returncode == 1
    require_schema(tmp_path / "latest")
