"""Jobs of verbs: their options, and their start by the names of their modules."""

from functools import partial
from importlib import import_module
from typing import Any

from qmn.network.options import NetworkOptions
from qmn.network.topologies import add_topology
from qmn.options import add_options, read
from qmn.parser import Parser
from qmn.requests.run_options import RunOptions
from wire.parameters.option import WRITTEN
from wire.registered import JOB


def describe_job(
    parser: Parser,
    module: str,
    request: type[Any],
    *parts: type[Any],
    topology: str = "sdc",
    without: tuple[type[Any], ...] = (),
) -> None:
    """Describe a job whose request, with its parts, has all options beside those of its network.

    The network has no options of the bases `without`.
    """
    for kind in (request, *parts):
        add_options(parser, kind, group=JOB)
    add_topology(parser, topology)
    add_options(parser, NetworkOptions, without=without)
    add_options(parser, RunOptions, group=WRITTEN)
    parser.set_defaults(call=lambda arguments: run_job(module, read(request, arguments)))


def run_job(module: str, request: Any) -> int:
    """Run a job; its module is loaded now, because help has no use for it."""
    from qmn.jobs.run_context import guarded

    return guarded(partial(import_module(module).run, request))
