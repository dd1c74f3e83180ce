"""Classes of a user's own, each from a file that is named as "path/to/file.py:ClassName".

The file is on this machine's disk and its name comes from whoever starts the network, as the
topology itself does; nothing that comes over the network ever names one.
"""

import importlib.util
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

from wire.config import BadConfig


def load_class(
    what: str,
    reference: str,
    needed: str = "",
    fits: Callable[[type[Any]], bool] = lambda _kind: True,
) -> type[Any]:
    """Return the class that a reference names; `what` says what it is to be.

    Raise BadConfig where there is none, or none that `fits`, which `needed` says in words.
    """
    file, _, name = reference.rpartition(":")
    found = getattr(_module(f"{what} {reference}", Path(file)), name, None)
    if not isinstance(found, type) or not fits(found):
        words = f" {needed}" if needed else ""
        raise BadConfig(f"{what} {reference}: {file} has no class {name}{words}")
    return found


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
    return module
