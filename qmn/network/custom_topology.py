"""Topologies of the user's own, as FILE.py:CLASS on the command line.

The file is this machine's, and runs as root, like any script that starts a network.
"""

import importlib.util
import inspect
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

from mininet.topo import Topo


class BadTopology(Exception):
    """What the user asked of a topology cannot be had; the text names value and remedy."""


def is_custom(name: str) -> bool:
    """Return whether a topology is named by its file and class."""
    return ":" in name


def short_name(name: str) -> str:
    """Return what to call a topology in the name of a folder: its class, if it has a file."""
    return name.rpartition(":")[2]


def load(name: str, given: Mapping[str, Any]) -> Callable[[], Topo]:
    """Return what builds FILE.py:CLASS with these parameters of `build`.

    Raise BadTopology for a file, class or parameter that there is not.
    """
    path, _, class_name = name.rpartition(":")
    file = Path(path)
    if not file.is_file():
        raise BadTopology(f"topology {name}: there is no file {path}; write FILE.py:CLASS")
    topo_class = getattr(_module(name, file), class_name, None)
    if not (isinstance(topo_class, type) and issubclass(topo_class, Topo)):
        raise BadTopology(f"topology {name}: {path} has no class {class_name} of mininet.topo.Topo")
    for option in sorted(given.keys() - _takes(topo_class, given)):
        words = f"--{option.replace('_', '-')}"
        raise BadTopology(
            f"{words}: build of {class_name} takes no {option}; say it in {path}, or leave it out"
        )
    return partial(topo_class, **given)


def _takes(topo_class: type[Topo], given: Mapping[str, Any]) -> set[str]:
    """Return which of the parameters given, or more, its `build` takes."""
    parameters = inspect.signature(topo_class.build).parameters
    if any(each.kind == each.VAR_KEYWORD for each in parameters.values()):
        return {*parameters, *given}
    return set(parameters)


def _module(name: str, file: Path) -> object:
    spec = importlib.util.spec_from_file_location(f"custom_topology_{file.stem}", file)
    if spec is None or spec.loader is None:
        raise BadTopology(f"topology {name}: {file} is not a Python file; write FILE.py:CLASS")
    module = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
    except (ImportError, SyntaxError, NameError, OSError) as error:
        raise BadTopology(f"topology {name}: {file} cannot be loaded: {error}") from error
    return module
