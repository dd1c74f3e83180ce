"""Packages that an installation may lack: each is named with its remedy."""

import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest

from qmn.network.checks import check_network
from qmn.network.options import NetworkOptions
from qmn.options import BadInput
from qmn.project import remedy

ROOT = Path(__file__).resolve().parents[3]
FOLDERS = [
    *("wire", "programs", "dispatcher", "hosts", "controller_apps", "qswitch_agent", "copper"),
    *("gate", "topologies", "qmn", "applications", "evidence", "views", "labs"),
]
# Each statement names one module: ruff sees to that.
IMPORT = re.compile(r"^ *(?:import|from) (\w+)[\w.]*(?: import .*| as \w+)?$", re.M)
OF_DEBIAN = {"mininet"}  # `qmn doctor --install` brings it
OF_OTHERS = {"_typeshed", "eventlet", "dask", "IPython"}  # mypy, Ryu, distributed and Jupyter
# Programs for SeQUeNCe's own environment, whose figures are kept in the tree.
ELSEWHERE = {"sequence"}


def third_parties() -> Iterator[tuple[Path, str]]:
    """Yield each module of others that a file imports, wherever it does so."""
    ours = {*FOLDERS, *sys.stdlib_module_names, "__future__"}
    for folder in FOLDERS:
        for file in (ROOT / folder).rglob("*.py"):
            beside = {each.stem for each in file.parent.glob("*.py")}
            for name in {*IMPORT.findall(file.read_text())} - ours - beside:
                yield file, name


def test_each_package_is_a_dependency_or_of_an_extra_that_its_absence_names() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    always = " ".join(project["dependencies"]).lower().replace("-", "_")
    distributions = packages_distributions()
    known = OF_DEBIAN | OF_OTHERS | ELSEWHERE
    checked = set()
    for file, name in third_parties():
        distribution = distributions.get(name, [name])[0].lower().replace("-", "_")
        if name in known or distribution in always or name.lower() in always:
            continue
        checked.add(name)
        assert remedy(ModuleNotFoundError(name=name)), f"{file}: {name} is in no extra"
    assert {"ldpc", "netqasm", "scipy", "distributed"} <= checked


WITHOUT = """
import importlib.util, sys
find = importlib.util.find_spec
importlib.util.find_spec = lambda name, *more: None if name == {name!r} else find(name, *more)
from qmn.network.checks import check_network
from qmn.network.options import NetworkOptions
from qmn.options import BadInput
try:
    check_network(NetworkOptions(topology="sdc", controller={controller!r}))
except BadInput as error:
    print(error)
"""


@pytest.mark.parametrize(
    ("controller", "name", "text"),
    [
        ("ryu", "ryu", "ryu is not installed, which this needs: pip install 'qmn[ryu]'"),
        ("os-ken", "os_ken", "os_ken is not installed (docs/packages.md), or choose ryu"),
    ],
)
def test_a_controller_whose_framework_is_missing_is_refused_with_the_remedy(
    controller: str, name: str, text: str
) -> None:
    program = WITHOUT.format(name=name, controller=controller)
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert f"--controller {controller}: " in done.stdout
    assert text in done.stdout


def test_a_controller_that_is_there_is_taken() -> None:
    check_network(NetworkOptions(topology="sdc", controller="os-ken"))
    with pytest.raises(BadInput, match="--rest needs --controller ryu"):
        check_network(NetworkOptions(topology="sdc", controller="os-ken", rest="127.0.0.1:8080"))
