"""Results of two runs, of this version and of an older one."""

import json
import os
from pathlib import Path
from typing import Any

import pytest
from recorded_run import record_run

from qmn.__main__ import described

OLD, NEW = "20260101T100000-chain", "20260301T100000-chain-1"


@pytest.fixture
def runs(tmp_path: Path) -> Path:
    """A folder with two runs, of which the second was not done, and what is none."""
    folder = tmp_path / "runs"
    for name, delivered in ((OLD, True), (NEW, False)):
        (folder / name).mkdir(parents=True)
        record_run(folder / name, delivered=delivered)
    (folder / "latest").symlink_to(NEW)
    (folder / "notes").mkdir()
    return folder


def change(run: Path, **facts: Any) -> None:
    """Let a result say something else, at another time."""
    result = run / "result.json"
    known = json.loads(result.read_text())
    known["parameters"] |= {name: facts.pop(name) for name in [*facts] if name not in known}
    known |= facts
    result.write_text(json.dumps(known))
    os.utime(result, ns=(1, result.stat().st_mtime_ns + 1))


def called(runs: Path, *words: str) -> int:
    """Run the verb."""
    arguments = described(["runs"]).parse_args(["runs", "--runs", str(runs), *words])
    status: int = arguments.call(arguments)
    return status
