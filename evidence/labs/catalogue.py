"""The labs that there are: the folders of labs/, those of packages, and others by their path."""

from collections.abc import Mapping
from functools import cache
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

from evidence.labs.lab import Lab
from qmn.options import BadInput
from topologies.system.processes.programs import ROOT
from wire.parameters.checks import remedy
from wire.registered import Registry

LABS = ROOT / "labs"


def names(folder: Path = LABS) -> list[str]:
    return list(_known(folder))


def lab(name: str, folder: Path = LABS) -> Lab:
    """Return the lab of this name, or of this path; raise BadInput if there is none."""
    if "/" in name:
        place = Path(name).resolve()
        folder, name = place.parent, place.name
    labs = _known(folder) if folder.is_dir() else {}
    if name not in labs:
        text = remedy(name, list(labs))
        if folder != LABS:
            text = f"{_file(folder, name)} is to say LAB = Lab(…)"
        raise BadInput(f"there is no lab {name}: {text}")
    entry = labs[name]
    return entry if isinstance(entry, Lab) else _loaded(entry)


def _known(folder: Path) -> Mapping[str, Lab | Path]:
    """Return the files of a folder's labs by name, and beside our own the labs of packages."""
    return _ours() if folder == LABS else _in(folder)


def _in(folder: Path) -> dict[str, Lab | Path]:
    files = {path.name: _file(folder, path.name) for path in sorted(folder.iterdir())}
    return {name: file for name, file in files.items() if file.exists()}


@cache
def _ours() -> Mapping[str, Lab | Path]:
    return Registry("qmn.labs", lambda each: isinstance(each, Lab), _in(LABS))


def _file(folder: Path, name: str) -> Path:
    """Return the file of a lab, which is called as its folder: sdc-fibre/sdc_fibre.py."""
    return folder / name / f"{name.replace('-', '_')}.py"


def _loaded(file: Path) -> Lab:
    spec = spec_from_file_location(f"lab_{file.stem}", file)
    assert spec is not None
    assert spec.loader is not None
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    entry: Lab = module.LAB
    return entry
