"""qmn run keys: hosts keep keys, and deliver them to programs."""

import argparse

from applications.keys.options import KeyServiceOptions
from applications.keys.request import KeysRequest, PassingEve
from qmn.jobs.start import run_job
from qmn.network.options import NetworkOptions
from qmn.network.topologies import add_topology
from qmn.options import add_options, read
from qmn.parser import Parser
from qmn.registered import JOB
from qmn.requests.run_options import RunOptions
from wire.parameters.option import WRITTEN

HELP = "keep keys of hosts, and deliver them to programs (ETSI GS QKD 014)"


def describe(parser: Parser) -> None:
    for kind in (KeysRequest, KeyServiceOptions, PassingEve):
        add_options(parser, kind, group=JOB)
    add_topology(parser)
    add_options(parser, NetworkOptions)
    add_options(parser, RunOptions, group=WRITTEN)
    parser.set_defaults(call=_call)


def _call(arguments: argparse.Namespace) -> int:
    return run_job("applications.keys.job", keys_request(arguments))


def keys_request(arguments: argparse.Namespace) -> KeysRequest:
    return read(KeysRequest, arguments)
