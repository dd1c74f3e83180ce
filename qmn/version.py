"""The name and version of this program, which pyproject.toml says."""

import argparse
import tomllib
from typing import Any

from topologies.system.processes.programs import ROOT


def name_and_version() -> str:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    return f"{project['name']} {project['version']}"


class ShowVersion(argparse.Action):
    """Prints name and version, and ends the program; only then is the file read."""

    def __init__(self, option_strings: list[str], dest: str, **given: Any) -> None:
        super().__init__(option_strings, argparse.SUPPRESS, nargs=0, **given)

    def __call__(self, parser: argparse.ArgumentParser, *_given: Any) -> None:
        print(name_and_version())
        parser.exit()
