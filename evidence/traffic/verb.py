"""qmn run load: heavy traffic."""

import argparse

from evidence.traffic.request import LoadRequest
from qmn.jobs.start import run_job
from qmn.network.options import KEYS, NetworkOptions
from qmn.network.topologies import add_topology
from qmn.options import add_options, read
from qmn.parser import Parser
from qmn.registered import JOB
from qmn.requests.run_options import RunOptions
from wire.parameters.option import WRITTEN

HELP = "heavy traffic: many sessions of many hosts"


def describe(parser: Parser) -> None:
    add_options(parser, LoadRequest, group=JOB)
    add_topology(parser, "ring")
    add_options(parser, NetworkOptions, leave_out=KEYS)
    add_options(parser, RunOptions, group=WRITTEN)
    parser.set_defaults(call=_call)


def _call(arguments: argparse.Namespace) -> int:
    return run_job("evidence.traffic.job", load_request(arguments))


def load_request(arguments: argparse.Namespace) -> LoadRequest:
    return read(LoadRequest, arguments)
