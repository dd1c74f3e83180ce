"""A run that fails: what it leaves and says."""

import errno
import json
import os
import shutil
from collections.abc import Callable
from functools import partial
from pathlib import Path

import pytest
from recorded_run import NETWORK, service_run
from rich.console import Console

from qmn.jobs.run_context import ending, guarded
from qmn.network.options import NetworkOptions
from qmn.results.artifacts import artifacts_of
from qmn.results.run_result import RunResult
from topologies.networks.disk import GONE
from topologies.networks.network import Interrupted, Signals
from topologies.system.processes.programs import NetworkError
from views.report.run_facts import BadRun, read_result

FAULTS = pytest.mark.parametrize(
    ("make", "status", "words"),  # a new one: notes stay with an error
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
    output = capsys.readouterr()
    assert output.out == ""
    assert output.err.splitlines() == [words, f"report to look at: {report}"]
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


@pytest.mark.parametrize(
    "fault", [NetworkError("tcpdump has died"), OSError(2, "No such file"), None]
)
@pytest.mark.parametrize("renamed", [True, False])
def test_a_run_whose_folder_is_removed_or_renamed_says_so_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], fault: Exception | None, renamed: bool
) -> None:
    folder = tmp_path / "run"
    folder.mkdir()

    def work(_signals: Signals, _console: Console) -> int:
        with ending(folder, service_run(), RunResult.write):
            folder.rename(tmp_path / "elsewhere") if renamed else folder.rmdir()
            if fault is not None:
                raise fault
        return 0

    assert guarded(work) == 1
    assert capsys.readouterr().err == f"qmn: {folder}: {GONE}\n"
    assert not folder.exists()


@pytest.mark.parametrize("number", [errno.EACCES, errno.EROFS])
def test_a_run_whose_folder_cannot_be_written_says_so(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], number: int
) -> None:
    assert failed(tmp_path, service_run(), OSError(number, os.strerror(number)))[0] == 1
    text = capsys.readouterr().err
    assert text.startswith(f"qmn: cannot write to the folder of the run, {tmp_path}: ")


def test_a_network_of_a_script_whose_folder_is_removed_says_so(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    with (
        pytest.raises(NetworkError, match="was removed or renamed"),
        artifacts_of(NetworkOptions(), folder),
    ):
        shutil.rmtree(folder)
