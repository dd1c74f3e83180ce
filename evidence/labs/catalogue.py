"""The labs that there are: the folders of labs/, and any other that is named by its path."""

from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

from evidence.labs.lab import Lab
from qmn.options import BadInput
from topologies.system.processes.programs import ROOT
from wire.parameters.checks import remedy

LABS = ROOT / "labs"


def names(folder: Path = LABS) -> list[str]:
    return sorted(path.name for path in folder.iterdir() if _file(folder, path.name).exists())


def lab(name: str, folder: Path = LABS) -> Lab:
    """Return the lab of this name, or of this path; raise BadInput if there is none."""
    if "/" in name:
        place = Path(name).resolve()
        folder, name = place.parent, place.name
    known = names(folder) if folder.is_dir() else []
    if name not in known:
        text = remedy(name, known)
        if folder != LABS:
            text = f"{_file(folder, name)} is to say LAB = Lab(…)"
        raise BadInput(f"there is no lab {name}: {text}")
    return _loaded(_file(folder, name))


def _file(folder: Path, name: str) -> Path:
    """Return the file of a lab, which is called as its folder: sdc-fibre/sdc_fibre.py."""
    return folder / name / f"{name.replace('-', '_')}.py"


def _loaded(file: Path) -> Lab:
    spec = spec_from_file_location(f"lab_{file.stem}", file)
    assert spec is not None
    assert spec.loader is not None
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    found: Lab = module.LAB
    return found
