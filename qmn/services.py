"""Public API of services: their declaration, their two ends, and their place on the command line.

services.pyi says where each name is. They are loaded when they are asked for, because controller,
switches and dispatcher read the declarations alone: docs/adding-a-service.md.
"""

import ast
from importlib import import_module
from pathlib import Path
from typing import Any

_PLACES = {
    alias.name: str(node.module)
    for node in ast.parse(Path(__file__).with_suffix(".pyi").read_text()).body
    if isinstance(node, ast.ImportFrom)
    for alias in node.names
}


def __dir__() -> list[str]:
    return sorted(_PLACES)


def __getattr__(name: str) -> Any:
    if name not in _PLACES:
        raise AttributeError(f"qmn.services has no {name}")
    return getattr(import_module(_PLACES[name]), name)
