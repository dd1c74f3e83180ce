"""Topologies of the user's own, as FILE.py:CLASS on the command line.

The file is this machine's, and runs as root, like any script that starts a network.
"""

import inspect
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

from mininet.topo import Topo

from wire.config import BadConfig
from wire.custom_class import load_class


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
    try:
        topo_class = load_class("topology", name, "of mininet.topo.Topo", _is_topology)
    except BadConfig as error:
        raise BadTopology(str(error)) from error
    for option in sorted(given.keys() - _takes(topo_class, given)):
        words = f"--{option.replace('_', '-')}"
        raise BadTopology(
            f"{words}: build of {class_name} takes no {option}; say it in {path}, or leave it out"
        )
    build: Callable[..., Topo] = topo_class
    return partial(build, **given)


def _takes(topo_class: type[Topo], given: Mapping[str, Any]) -> set[str]:
    """Return which of the parameters given, or more, its `build` takes."""
    parameters = inspect.signature(topo_class.build).parameters
    if any(each.kind == each.VAR_KEYWORD for each in parameters.values()):
        return {*parameters, *given}
    return set(parameters)


def _is_topology(kind: type[Any]) -> bool:
    return issubclass(kind, Topo)
