"""Classes of a user's own, by file, as "path/to/file.py:ClassName", or registered by a package.

The file is on this machine's disk and its name comes from the user who starts the network, as the
topology itself does; nothing that comes over the network ever names one.
"""

import importlib.util
import shlex
import sys
import traceback
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

from wire.config import BadConfig
from wire.parameters.checks import remedy
from wire.registered import HARDWARE, NOISE, TOPOLOGIES, BadPackage, load, registered

GROUPS = {"noise": NOISE, "qnic": HARDWARE, "topology": TOPOLOGIES}


def load_class(
    what: str,
    reference: str,
    needed: str = "",
    fits: Callable[[type[Any]], bool] = lambda _kind: True,
) -> type[Any]:
    """Return the class that a reference names; `what` says what it is to be.

    Raise BadConfig where there is none, or none that `fits`, which `needed` says in words.
    """
    if (entry := registered(GROUPS[what]).get(reference)) is not None:
        try:
            kind: type[Any] = load(entry, lambda each: isinstance(each, type) and fits(each))
        except BadPackage as error:
            raise BadConfig(f"{what} {error}") from error
        return kind
    file, _, name = reference.rpartition(":")
    module = _module(f"{what} {reference}", Path(file))
    loaded = getattr(module, name, None)
    if not isinstance(loaded, type) or not fits(loaded):
        suffix = f" {needed}" if needed else ""
        names = [
            value.__name__
            for value in vars(module).values()
            if isinstance(value, type) and value.__module__ == module.__name__ and fits(value)
        ]
        raise BadConfig(
            f"{what} {reference}: {file} has no class {name}{suffix}: {remedy(name, names)}"
        )
    return loaded


def _module(where: str, file: Path) -> ModuleType:
    if not file.is_file():
        raise BadConfig(f"{where}: there is no file {file}; write FILE.py:CLASS")
    spec = importlib.util.spec_from_file_location(f"custom_{file.stem}", file)
    if spec is None or spec.loader is None:
        raise BadConfig(f"{where}: {file} is not a Python file; write FILE.py:CLASS")
    module = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
    except (ImportError, SyntaxError, NameError, OSError) as error:
        raise BadConfig(f"{where}: {file} cannot be loaded: {error}") from error
    except Exception as error:  # it is another's program, which may raise any
        text = f"{where}: {file} cannot be loaded: {fault_in(file, error)}"
        raise BadConfig(f"{text}; this shows all of it: {_command_that_runs(file)}") from error
    return module


def _command_that_runs(file: Path) -> str:
    checkout = Path(__file__).resolve().parents[1]
    return f"PYTHONPATH={shlex.quote(str(checkout))} {shlex.join([sys.executable, str(file)])}"


def fault_in(file: Path, error: Exception) -> str:
    line = line_in(file, error)
    return f"{f'line {line}: ' if line else ''}{type(error).__name__}: {error}"


def line_in(file: Path, error: Exception) -> int | None:
    """Return the innermost line of a file that an exception came through; None: through none."""
    frames = traceback.extract_tb(error.__traceback__)
    lines = [frame.lineno for frame in frames if Path(frame.filename).resolve() == file.resolve()]
    return lines[-1] if lines else None
