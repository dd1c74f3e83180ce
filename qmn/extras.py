"""Python packages that a part of qmn needs, as extras of the package `qmn`; a checkout has all."""

import tomllib

from topologies.system.processes.programs import ROOT

MODULES = {"dask": "distributed"}  # whose name is not that of the package that brings them


def remedy(error: ModuleNotFoundError) -> str | None:
    """Return what is missing and how to install it; None if it is of no extra."""
    package = MODULES.get(error.name or "", error.name or "").split(".")[0]
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    for extra, wanted in project["optional-dependencies"].items():
        if package in (each.split("==")[0] for each in wanted):
            return f"{package} is not installed, which this needs: pip install 'qmn[{extra}]'"
    return None
