"""A wheel, installed where no checkout is: one name for others, and `qmn run sdc` works."""

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


def built(folder: Path) -> Path:
    words = ["-m", "hatchling", "build", "-t", "wheel", "-d", str(folder)]
    environment = {**os.environ, "SOURCE_DATE_EPOCH": "1700000000"}
    subprocess.run([sys.executable, *words], cwd=ROOT, env=environment, check=True)
    (wheel,) = folder.iterdir()
    return wheel


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return built(tmp_path_factory.mktemp("dist"))


def test_the_same_tree_gives_the_same_bytes(wheel: Path, tmp_path: Path) -> None:
    assert built(tmp_path).read_bytes() == wheel.read_bytes()


def test_a_wheel_has_one_name_and_all_of_the_tree(wheel: Path) -> None:
    names = ZipFile(wheel).namelist()
    assert {name.split("/")[0].split("-")[0] for name in names} == {"qmn"}
    listed = subprocess.check_output(["git", "-c", f"safe.directory={ROOT}", "ls-files"], cwd=ROOT)
    tracked = [each for each in listed.decode().splitlines() if each.endswith((".py", ".lua"))]
    outside = ("docs", "examples", "setup", "tests")
    left_out = {f"qmn/tree/{each}" for each in tracked if each.split("/")[0] not in outside}
    assert left_out - set(names) == set()


def test_an_installed_wheel_runs_a_network(wheel: Path, tmp_path: Path) -> None:
    place = tmp_path / "environment"
    EnvBuilder(with_pip=True).create(place)
    # What the wheel depends on is this checkout's.
    (others,) = place.glob("lib/python3*/site-packages")
    (others / "others.pth").write_text(f"{PACKAGES}\n")
    python = place / "bin" / "python"
    pip = [str(python), "-m", "pip", "install", "--quiet", "--no-deps", "--no-index", str(wheel)]
    subprocess.run(pip, check=True)
    environment = {name: os.environ[name] for name in ("PATH", "HOME") if name in os.environ}
    elsewhere = {"cwd": tmp_path, "env": environment, "text": True}
    output = subprocess.check_output([python, "-c", SCRIPT], **elsewhere)  # type: ignore[call-overload]
    assert output == f"topologies.quantum_topo {others}/qmn/tree/qmn/scripting/__init__.py\n"
    command = [place / "bin" / "qmn", "run", "sdc", "--message", "installed"]
    output = subprocess.check_output(command, **elsewhere)  # type: ignore[call-overload]
    assert "9 bytes, delivered exactly" in output
