"""qmn run vpn: a tunnel whose keys are of light."""

import argparse

from applications.keys.request import PassingEve
from applications.vpn.request import VpnRequest
from qmn.jobs.start import run_job
from qmn.network.options import NetworkOptions
from qmn.network.topologies import add_topology
from qmn.options import add_options, read
from qmn.parser import Parser
from qmn.registered import JOB
from qmn.requests.run_options import RunOptions
from wire.parameters.option import WRITTEN

HELP = "a VPN whose keys are of light, with a file moving through it"


def describe(parser: Parser) -> None:
    for kind in (VpnRequest, PassingEve):
        add_options(parser, kind, group=JOB)
    add_topology(parser)
    add_options(parser, NetworkOptions)
    add_options(parser, RunOptions, group=WRITTEN)
    parser.set_defaults(call=_call)


def _call(arguments: argparse.Namespace) -> int:
    return run_job("applications.vpn.job", vpn_request(arguments))


def vpn_request(arguments: argparse.Namespace) -> VpnRequest:
    return read(VpnRequest, arguments)
