"""The name, version and extras of this program, which pyproject.toml says."""

import argparse
import tomllib
from typing import Any

from topologies.system.processes.programs import ROOT

MODULES = {"dask": "distributed"}  # whose name is not that of the package that brings them


def project() -> dict[str, Any]:
    table: dict[str, Any] = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    return table


class ShowVersion(argparse.Action):
    """Prints name and version, and ends the program; only then is the file read."""

    def __init__(self, option_strings: list[str], dest: str, **value: Any) -> None:
        super().__init__(option_strings, argparse.SUPPRESS, nargs=0, **value)

    def __call__(self, parser: argparse.ArgumentParser, *_given: Any) -> None:
        print("{name} {version}".format_map(project()))
        parser.exit()


def remedy(error: ModuleNotFoundError) -> str | None:
    """Return what is missing and how to install it; None if it is of no extra."""
    package = MODULES.get(error.name or "", error.name or "").split(".")[0]
    for extra, packages in project()["optional-dependencies"].items():
        if package in (each.split("==")[0] for each in packages):
            return f"{package} is not installed, which this needs: pip install 'qmn[{extra}]'"
    return None
