"""The core without the packages around it."""

import json
import re
import shutil
import subprocess
import sys
from configparser import ConfigParser
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
TESTS = ROOT / "tests"
IMPORTED = re.compile(r"^(?:from|import) (\w+)", re.MULTILINE)
AROUND = ("applications", "course", "evidence")
NOT_COPIED = {*AROUND, *(f"{name}.dist-info" for name in AROUND), "labs", "runs", ".git", ".venv"}
ROOMS = (
    *("controller_apps", "copper", "dispatcher", "hosts", "programs", "qmn", "qswitch_agent"),
    *("topologies", "wire"),
)
REGISTERED = ("qmn.services", "qmn.service_verbs", "qmn.jobs", "qmn.standing_jobs")
BY_DAY = slice(2, None, 32)  # of the files of a room: some that take no time


def mention_of_packages() -> re.Pattern[str]:
    """Return what finds the packages around the core in a test, or a service or job of theirs."""
    points = ConfigParser()
    points.read(ROOT / f"{name}.dist-info" / "entry_points.txt" for name in AROUND)
    names = [name for group in REGISTERED if group in points for name in points[group]]
    capitals, quoted = "|".join(map(str.upper, names)), "|".join(names)
    return re.compile(rf"\b({'|'.join(AROUND)}|labs|{capitals})\b|[\"']({quoted})\b")


def with_helpers(file: Path) -> set[Path]:
    """Return a file of tests, and those that it imports from its folder."""
    found, new = set[Path](), {file}
    while new:
        found |= new
        names = {name for each in new for name in IMPORTED.findall(each.read_text())}
        places = (folder / f"{name}.py" for name in names for folder in (file.parent, TESTS))
        new = {place for place in places if place.exists()} - found
    return found


def files_without_packages(room: str) -> list[str]:
    """Return the files of tests of a room that mention no package around the core."""
    mention = mention_of_packages()
    files = [
        file
        for file in sorted((TESTS / "unit" / room).rglob("test_*.py"))
        if not any(mention.search(each.read_text()) for each in with_helpers(file))
    ]
    assert files, room
    return [str(file.relative_to(ROOT)) for file in files]


@pytest.fixture(scope="module")
def core(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a copy of the tree without the packages around the core."""
    copy = tmp_path_factory.mktemp("core") / "qmn"

    def left_out(folder: str, names: list[str]) -> set[str]:
        return NOT_COPIED.intersection(names) if folder == str(ROOT) else {"__pycache__"}

    shutil.copytree(ROOT, copy, ignore=left_out)
    (copy / ".venv").symlink_to(ROOT / ".venv")
    return copy


def test_a_message_is_sent_by_the_core_alone(core: Path, tmp_path: Path) -> None:
    command = ["bin/qmn", "run", "sdc", "--message", "alone", "--runs", str(tmp_path)]
    done = subprocess.run(command, cwd=core, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    (run,) = tmp_path.glob("*-sdc")
    assert json.loads((run / "result.json").read_text())["delivered"] is True
    assert (run / "report.html").exists()
    usage = subprocess.run(["bin/qmn", "--help"], cwd=core, capture_output=True, text=True)
    assert "netqasm" not in usage.stdout
    assert "make experiments" not in usage.stdout


@pytest.mark.timeout(2400)
@pytest.mark.parametrize(
    "chosen", [BY_DAY, pytest.param(slice(None), marks=pytest.mark.nightly)], ids=["some", "all"]
)
def test_the_tests_of_the_core_pass_alone(core: Path, chosen: slice) -> None:
    plugins = ("progress", "garbage", "nightly", "default_signals")
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-m", "not nightly"]
    command += [word for name in plugins for word in ("-p", name)]
    tests = [file for room in ROOMS for file in files_without_packages(room)[chosen]]
    done = subprocess.run(
        [*command, *tests],
        cwd=core,
        env={"PATH": "/usr/sbin:/usr/bin:/sbin:/bin", "PYTHONPATH": f"{core}:{core}/tests"},
        capture_output=True,
        text=True,
        timeout=2300,
    )
    assert done.returncode == 0, done.stdout[-4000:] + done.stderr
