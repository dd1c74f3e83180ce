"""Packages that only a part of qmn needs are named with the extra that brings them."""

import tomllib

import pytest

from qmn.project import remedy
from topologies.system.processes.programs import ROOT

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]


@pytest.mark.parametrize(
    ("module", "extra"),
    [("ldpc", "ldpc"), ("netqasm.sdk", "netqasm"), ("dask", "evidence"), ("ryu", "ryu")],
)
def test_the_extra_of_a_missing_module_is_named(module: str, extra: str) -> None:
    text = remedy(ModuleNotFoundError(name=module))
    assert text is not None
    assert text.endswith(f"pip install 'qmn[{extra}]'")


@pytest.mark.parametrize("module", ["numpy", "no_such_module", None])
def test_no_extra_is_named_for_other_modules(module: str | None) -> None:
    assert remedy(ModuleNotFoundError(name=module)) is None


def test_wheels_are_built_by_the_locked_versions() -> None:
    build = tomllib.loads((ROOT / "pyproject.toml").read_text())["build-system"]["requires"]
    lock = (ROOT / "requirements.lock").read_text().split()
    assert [each for each in build if each not in lock] == []
