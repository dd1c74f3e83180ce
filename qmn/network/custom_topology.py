"""Topologies of the user's own, as FILE.py:CLASS on the command line.

The file is this machine's, and runs as root, like any script that starts a network.
"""

import inspect
import shlex
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

from mininet.topo import Topo

from programs.custom_class import fault_in, line_in, load_class
from topologies.description.checked_graph import checked
from topologies.links.fiber import OPTICS
from topologies.system.processes.programs import ROOT, python
from wire.config import BadConfig
from wire.parameters.physics import BadParameter
from wire.registered import TOPOLOGIES, registered


class BadTopology(Exception):
    """The topology cannot be as requested; the text names value and remedy."""


def is_custom(name: str) -> bool:
    return ":" in name or name in registered(TOPOLOGIES)


def short_name(name: str) -> str:
    """Return what to call a topology in the name of a folder: its class, if it has a file."""
    return name.rpartition(":")[2]


def load(name: str, options: Mapping[str, Any]) -> Callable[[], Topo]:
    """Return what builds FILE.py:CLASS with these parameters of `build`.

    Raise BadTopology for a file, class or parameter that there is not; what is returned raises it
    for what its `build` does wrong.
    """
    path, class_name = name.rpartition(":")[0] or "its package", short_name(name)
    try:
        topo_class = load_class("topology", name, "of mininet.topo.Topo", _is_topology)
    except BadConfig as error:
        raise BadTopology(str(error)) from error
    for option in sorted(options.keys() - _takes(topo_class, options)):
        of_some = f" or of single fibres (--fiber A-B.{option}=VALUE)," if option in OPTICS else ""
        raise BadTopology(
            f"build of {class_name} takes no {option}; say it in {path},{of_some} or leave it out"
        )
    return partial(_built, topo_class, name, options)


def _built(topo_class: type[Topo], name: str, options: Mapping[str, Any]) -> Topo:
    """Return the topology; raise BadTopology, with the user's file and line, if it cannot be."""
    class_name, path = topo_class.__name__, name.rpartition(":")[0]
    file = str(Path(path).absolute()) if path else inspect.getfile(topo_class)
    try:
        return checked(topo_class)(**options)
    except BadTopology:
        raise
    except (BadParameter, BadConfig) as error:
        line = line_in(Path(file), error)
        where = f"{file}, line {line}" if line else name
        raise BadTopology(f"{where}: {error}") from error
    except Exception as error:  # it is another's program, which may raise any
        whole = _command_that_builds(file, class_name, options)
        fault = fault_in(Path(file), error)
        raise BadTopology(f"{file}, {fault}; this shows all of it: {whole}") from error


def _command_that_builds(file: str, class_name: str, options: Mapping[str, Any]) -> str:
    keywords = ", ".join(f"{name}={value!r}" for name, value in options.items())
    program = f"import runpy; runpy.run_path({file!r})[{class_name!r}]({keywords})"
    return f"PYTHONPATH={shlex.quote(str(ROOT))} {shlex.join([python(), '-c', program])}"


def _takes(topo_class: type[Topo], options: Mapping[str, Any]) -> set[str]:
    parameters = inspect.signature(topo_class.build).parameters
    if any(parameter.kind == parameter.VAR_KEYWORD for parameter in parameters.values()):
        return {*parameters, *options}
    return set(parameters)


def _is_topology(kind: type[Any]) -> bool:
    return issubclass(kind, Topo)
