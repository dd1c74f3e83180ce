"""qmn run JOB: start a network, do its job, report, clean up."""

import argparse
from functools import partial
from typing import Any

from hosts.middleware.services import named
from hosts.middleware.services.superdense.options import SuperdenseOptions
from hosts.middleware.session.options import SessionLight, SessionSource
from hosts.timeouts import MAX_BLOCK_S
from qmn.jobs.start import run_job
from qmn.needs import Needs
from qmn.network.options import NetworkOptions
from qmn.network.topologies import add_topology, described_topologies
from qmn.options import add_options, read, titled
from qmn.parser import Parser
from qmn.requests.run_options import RunOptions
from qmn.requests.service import ServiceRequest, ends_of_line, parts_of
from qmn.requests.service_verbs import APPLICATION_PORT, SERVICE_PORT, VERBS, Verb
from qmn.requests.superdense import SuperdenseRequest
from wire.parameters.network import KeySettings
from wire.parameters.option import WRITTEN, Declaration
from wire.registered import JOB, JOBS, Registry

HOST: Declaration = {
    "flag": "--to",
    "default": "bob",
    "metavar": "HOST",
    "help": "host that accepts the session (bob)",
}


def add_parser(verbs: Any) -> None:
    parser = verbs.add_parser(
        "run",
        description=__doc__,
        epilog=described_topologies(),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.set_defaults(needs=Needs.NETWORK)
    jobs = parser.add_subparsers(dest="job", metavar="JOB", required=True)
    _add_superdense(jobs)
    for name, verb in VERBS.items():
        _add_service(jobs, name, verb)
    for name, job in Registry[Any](JOBS, lambda it: {"HELP", "describe"} <= {*dir(it)}, {}).items():
        parser = jobs.add_parser(name, help=job.HELP, description=job.HELP)
        parser.put_off(partial(job.describe, parser))


def _add_superdense(jobs: Any) -> None:
    text = "send a message by superdense coding"
    parser = jobs.add_parser("sdc", help=text, description=text)
    parser.put_off(partial(_describe_superdense, parser))


def _describe_superdense(parser: Parser) -> None:
    add_options(parser, SuperdenseRequest, group=JOB)
    add_options(
        parser,
        SuperdenseOptions,
        words={"host": {**HOST, "help": "receiving host (bob)"}},
        group=JOB,
    )
    add_topology(parser)
    add_options(parser, NetworkOptions, without=(KeySettings,))
    add_options(parser, RunOptions, group=WRITTEN)
    parser.set_defaults(call=_call_superdense)


def _call_superdense(arguments: argparse.Namespace) -> int:
    return run_job("qmn.jobs.superdense", superdense_request(arguments))


def superdense_request(arguments: argparse.Namespace) -> SuperdenseRequest:
    return read(SuperdenseRequest, arguments, port=APPLICATION_PORT)


def _add_service(jobs: Any, name: str, verb: Verb) -> None:
    parser = jobs.add_parser(name, help=verb.help, description=verb.help)
    parser.put_off(partial(_describe_service, parser, name, verb))


def _describe_service(parser: Parser, name: str, verb: Verb) -> None:
    parser.set_defaults(call=_call_service, service=name)
    if verb.protocols:
        name, *_ = verb.protocols
        text = f"protocol, with photons or pairs ({name})"
        titled(parser, JOB).add_argument(
            "--protocol", dest="service", choices=verb.protocols, default=name, help=text
        )
    if name not in named():
        parser.error(f"{name} cannot be used: its package is left out")
    kind = named()[name].options
    add_options(
        parser,
        kind,
        # The request has its own light, such that every source can make it.
        without=(SessionLight,) if verb.source else (SessionLight, SessionSource),
        words={} if verb.line else {"host": HOST},
        group=JOB,
    )
    rate = f"rate of the source ({kind.rate_hz}, or that of the slowest source)"
    block = f"pairs in a block ({kind.block_pairs}, or what is made in {MAX_BLOCK_S:g} s)"
    words: dict[str, Declaration] = {"rate_hz": {"help": rate}, "block_pairs": {"help": block}}
    for options in parts_of(verb):
        add_options(parser, options, words=words, group=JOB)
    add_topology(parser, verb.topology)
    add_options(parser, NetworkOptions, without=() if verb.keys else (KeySettings,))
    add_options(parser, RunOptions, group=WRITTEN)


def _call_service(arguments: argparse.Namespace) -> int:
    return run_job("qmn.jobs.counted_service", service_request(arguments))


def service_request(arguments: argparse.Namespace) -> ServiceRequest:
    ends = ends_of_line(arguments.service, getattr(arguments, "line", ""))
    parts = {"options": named()[arguments.service].options}
    return read(ServiceRequest, arguments, parts, port=SERVICE_PORT, **ends)
