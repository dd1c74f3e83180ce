"""qmn netqasm APP_DIR: run a NetQASM application on the hosts of a network (docs/netqasm.md)."""

import argparse
from functools import partial
from pathlib import Path
from typing import Any

from applications.netqasm import job as netqasm
from applications.netqasm.request import NetqasmRequest
from qmn.jobs.run_context import guarded
from qmn.machines.options import PlaceOptions
from qmn.needs import Needs
from qmn.network.options import NetworkOptions
from qmn.network.topologies import add_topology
from qmn.options import add_options, read
from qmn.requests.run_options import RunOptions
from wire.parameters.network import KeySettings
from wire.parameters.option import WRITTEN


def add_parser(verbs: Any) -> None:
    parser = verbs.add_parser("netqasm", usage="qmn netqasm APP_DIR [options]", description=__doc__)
    text = "folder of the application, with app_ROLE.py for each of its roles; or a NetQMPI program"
    parser.add_argument("path", type=Path, metavar="APP_DIR", help=text)
    add_options(parser, NetqasmRequest, group="the application")
    add_topology(parser)
    add_options(parser, NetworkOptions, without=(KeySettings,))
    add_options(parser, RunOptions, without=(PlaceOptions,), group=WRITTEN)
    parser.set_defaults(call=_call, needs=Needs.NETWORK)


def _call(arguments: argparse.Namespace) -> int:
    return guarded(partial(netqasm.run, request_of(arguments)))


def request_of(arguments: argparse.Namespace) -> NetqasmRequest:
    return read(NetqasmRequest, arguments)
