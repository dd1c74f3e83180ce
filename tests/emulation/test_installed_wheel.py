"""A wheel, installed where no checkout is: one name for others, and `qmn run sdc` works.

Beside it the wheel of examples/plugin, which extends it.
"""

import json
import os
import subprocess
import sys
import sysconfig
from pathlib import Path
from venv import EnvBuilder
from zipfile import ZipFile

import pytest

from topologies.system.processes.programs import ROOT

pytestmark = pytest.mark.nightly
PACKAGES = Path(sysconfig.get_path("purelib"))
SCRIPT = """
from qmn.topology import QuantumTopo
import qmn.scripting
print(QuantumTopo.__module__, qmn.scripting.__file__)
"""


LOAD = (
    "load --topology sdc --sessions 200 --rate-per-s 10 --holding-s 0.25 --deadline-s 1 "
    "--contention queue --captures none --without report"
)
PLUGIN = ROOT / "examples" / "plugin"


def built(folder: Path, source: Path = ROOT, target: str = "wheel") -> Path:
    words = ["-m", "hatchling", "build", "-t", target, "-d", str(folder)]
    environment = {**os.environ, "SOURCE_DATE_EPOCH": "1700000000"}
    subprocess.run([sys.executable, *words], cwd=source, env=environment, check=True)
    (made,) = folder.iterdir()
    return made


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return built(tmp_path_factory.mktemp("dist"))


def test_the_same_tree_gives_the_same_bytes(wheel: Path, tmp_path: Path) -> None:
    assert built(tmp_path / "wheel").read_bytes() == wheel.read_bytes()
    once, again = (built(tmp_path / each, target="sdist") for each in ("once", "again"))
    assert again.read_bytes() == once.read_bytes()


def test_a_wheel_has_one_name_and_all_of_the_tree(wheel: Path) -> None:
    names = ZipFile(wheel).namelist()
    assert {name.split("/")[0].split("-")[0] for name in names} == {"qmn"}
    listed = subprocess.check_output(["git", "-c", f"safe.directory={ROOT}", "ls-files"], cwd=ROOT)
    tracked = [each for each in listed.decode().splitlines() if each.endswith((".py", ".lua"))]
    outside = ("docs", "examples", "setup", "tests")
    assert not [name for name in names if "solutions" in name]  # of the course
    left_out = {f"qmn/tree/{each}" for each in tracked if each.split("/")[0] not in outside}
    assert left_out - set(names) == set()


def installed(place: Path, *wheels: Path) -> Path:
    """Return a new environment with these wheels; what they depend on is this checkout's."""
    EnvBuilder(with_pip=True).create(place)
    (others,) = place.glob("lib/python3*/site-packages")
    (others / "others.pth").write_text(f"{PACKAGES}\n")
    python, pip = place / "bin" / "python", ["-m", "pip", "install", "--quiet"]
    subprocess.run([python, *pip, "--no-deps", "--no-index", *wheels], check=True)
    return others


def output(folder: Path, *command: Path | str) -> str:
    environment = {name: os.environ[name] for name in ("PATH", "HOME") if name in os.environ}
    return subprocess.check_output(command, cwd=folder, env=environment, text=True)


def test_an_installed_wheel_runs_a_network(wheel: Path, tmp_path: Path) -> None:
    place = tmp_path / "environment"
    others = installed(place, wheel)
    shown = output(tmp_path, place / "bin" / "python", "-c", SCRIPT)
    assert shown == f"topologies.quantum_topo {others}/qmn/tree/qmn/scripting/__init__.py\n"
    shown = output(tmp_path, place / "bin" / "qmn", "run", "sdc", "--message", "installed")
    assert "9 bytes, delivered exactly" in shown


@pytest.fixture(scope="module")
def qmn(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return qmn where it and the package of examples/plugin are installed."""
    folder = tmp_path_factory.mktemp("extended")
    installed(folder / "environment", wheel, built(folder / "dist", PLUGIN))
    return folder / "environment" / "bin" / "qmn"


def test_a_package_of_a_third_party_extends_it(qmn: Path, tmp_path: Path) -> None:
    output(tmp_path, qmn, "run", "coin", "--topology", "corridor,switches=3", "--policy", "lifo")
    run = tmp_path / "runs" / "latest"
    job = json.loads((run / "result.json").read_text())["job"]
    assert job["asking"]["agreed"] == job["asking"]["coins"] > 0
    assert job["asked"] == job["asking"]
    assert "counting: " in (run / "alice.log").read_text()  # by the hardware of the package
    assert "coin.agreed" in (run / "qmn.lua").read_text()
    assert "within 5 standard errors" in output(tmp_path, qmn, "lab", "published", "coins")


def test_its_scheduler_passes_exercise_6_of_the_course(qmn: Path, tmp_path: Path) -> None:
    """The last request is served first."""
    runs = [tmp_path / "fcfs", tmp_path / "lifo"]
    for place, more in zip(runs, ([], ["--policy", "lifo"]), strict=True):
        output(tmp_path, qmn, "run", *LOAD.split(), *more, "--runs", str(place))
    words = [each for place in runs for each in ("--run", place / "latest")]
    answers = ROOT / "examples" / "solutions" / "answers.toml"
    shown = output(tmp_path, qmn, "course", "check", "6", *words, "--answer", answers)
    assert "missing" not in shown
