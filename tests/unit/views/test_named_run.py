"""A run is meant by its name, a part of it, or a path, by all verbs that look at one."""

from pathlib import Path

import pytest

from qmn.__main__ import described
from views.archive.named_run import UnknownRun, find_run

OLD, NEW = "20260101T100000-chain", "20260301T100000-chain-1"
OTHER = "20260401T120000-sdc"
VERBS = {
    "report": (),
    "spy": (),
    "live": (),
    "wireshark": (),
    "replay": (),
}


@pytest.fixture
def runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of three runs below the one where the user is, and the link to the newest."""
    for name in (OLD, NEW, OTHER, "notes"):
        (tmp_path / "runs" / name).mkdir(parents=True)
    (tmp_path / "runs" / "latest").symlink_to(OTHER)
    monkeypatch.chdir(tmp_path)
    return tmp_path / "runs"


@pytest.mark.parametrize("verb", VERBS)
@pytest.mark.parametrize("text", [OTHER, "sdc", "latest", f"runs/{OTHER}", "runs/latest"])
def test_every_verb_takes_a_name_or_a_path(runs: Path, verb: str, text: str) -> None:
    arguments = described([verb]).parse_args([verb, text, *VERBS[verb]])
    assert arguments.run.resolve() == runs / OTHER


def test_wireshark_is_of_the_newest_run_without_a_word(runs: Path) -> None:
    assert described(["wireshark"]).parse_args(["wireshark"]).run.resolve() == runs / OTHER


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("chain", f"'chain' is of 2 runs: choose one of {NEW}, {OLD}$"),
        ("20260401T120000-sdd", f"there is no run .*: did you mean {OTHER}\\?$"),
        ("teleport", f"there is no run 'teleport': choose one of {OTHER}, {NEW}, {OLD}$"),
        ("runs/20260401T120000-sd", f"there is no run .*: did you mean {OTHER}\\?$"),
        ("none/here", "there is no run 'none/here', and none in none: .*`qmn run sdc`"),
    ],
)
@pytest.mark.usefixtures("runs")
def test_what_no_run_or_more_than_one_is_called_is_refused(name: str, text: str) -> None:
    with pytest.raises(UnknownRun, match=text):
        find_run(name)


@pytest.mark.usefixtures("runs")
def test_of_many_runs_the_newest_are_named() -> None:
    for day in range(10, 20):
        Path("runs", f"202605{day}T100000-ring").mkdir()
    with pytest.raises(UnknownRun, match=r"of 10 runs.*20260519.*15T\S+-ring \(5 more: `qmn runs`"):
        find_run("ring")


def test_a_name_is_of_a_run_before_it_is_a_folder_here(runs: Path) -> None:
    Path(OLD).mkdir()
    assert find_run(OLD).resolve() == runs / OLD
    assert find_run(f"./{OLD}") == Path(OLD)


@pytest.mark.usefixtures("runs")
def test_where_one_is_can_be_a_run(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(Path("runs", OLD))
    assert [find_run(here).resolve().name for here in (".", "..")] == [OLD, "runs"]


def test_a_verb_says_it_in_one_line(runs: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit, match="2"):
        described(["report"]).parse_args(["report", "chain"])
    report = f"qmn report: error: RUN: 'chain' is of 2 runs: choose one of {NEW}, {OLD}"
    assert capsys.readouterr().err.splitlines() == [f"{report} (`qmn report --help` lists all)"]
    assert runs.is_dir()
