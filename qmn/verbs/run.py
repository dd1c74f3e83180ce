"""qmn run JOB: start a network, do its job, report, clean up."""

import argparse
from functools import partial
from typing import Any

from hosts.middleware.services import NAMES
from hosts.middleware.services.superdense.options import SuperdenseOptions
from hosts.timeouts import MAX_BLOCK_S
from qmn.jobs import counted_service, keys, load, superdense, vpn
from qmn.jobs.counted_service import ServiceRequest
from qmn.jobs.keys import KeysRequest
from qmn.jobs.load import LoadRequest
from qmn.jobs.passing_eavesdropper import PassingEve
from qmn.jobs.run_context import guarded
from qmn.jobs.run_options import RunOptions
from qmn.jobs.service_verbs import SERVICE_PORT, VERBS, Verb, verb_of
from qmn.jobs.superdense import SuperdenseRequest
from qmn.jobs.transfer import APPLICATION_PORT
from qmn.jobs.vpn import VpnRequest
from qmn.machines.options import MACHINES
from qmn.network.key_options import KeyServiceOptions
from qmn.network.options import KEYS, NetworkOptions
from qmn.network.topologies import TOPOLOGIES, add_topology, topology_name
from qmn.options import add_options, read
from qmn.parser import Parser


def add_parser(verbs: Any) -> None:
    """Describe the verb and its jobs."""
    words = "start a network and do its job"
    parser = verbs.add_parser("run", help=words, description=__doc__)
    parser.set_defaults(needs_root=True)
    jobs = parser.add_subparsers(dest="job", metavar="JOB", required=True)
    for name, (_topo, what) in TOPOLOGIES.items():
        _add_superdense(jobs, name, what)
    for name, verb in VERBS.items():
        _add_service(jobs, name, verb)
    _add_load(jobs)
    _add_keys(jobs)
    _add_vpn(jobs)


def _add_load(jobs: Any) -> None:
    """Describe heavy traffic."""
    text = "heavy traffic: many sessions of many hosts"
    parser = jobs.add_parser("load", help=text, description=text)
    parser.put_off(partial(_describe_load, parser))


def _describe_load(parser: Parser) -> None:
    add_options(parser, LoadRequest)
    add_topology(parser, "ring")
    add_options(parser, NetworkOptions, leave_out=KEYS)
    add_options(parser, RunOptions)
    parser.set_defaults(call=_call_load)


def _call_load(arguments: argparse.Namespace) -> int:
    return guarded(partial(load.run, load_request(arguments)))


def load_request(arguments: argparse.Namespace) -> LoadRequest:
    """Return what the command line asks for."""
    network, run = read(NetworkOptions, arguments), read(RunOptions, arguments)
    return read(LoadRequest, arguments, network=network, run=run)


def _add_superdense(jobs: Any, name: str, what: str) -> None:
    """Describe superdense coding, which is called as the topology that it runs on."""
    text = f"superdense coding over {what}"
    parser = jobs.add_parser(name, help=text, description=text)
    parser.put_off(partial(_describe_superdense, parser, name))


def _describe_superdense(parser: Parser, name: str) -> None:
    add_options(parser, SuperdenseRequest)
    add_options(parser, SuperdenseOptions, words=superdense.SESSION)
    add_options(parser, NetworkOptions, leave_out=KEYS)
    add_options(parser, RunOptions)
    parser.set_defaults(call=_call_superdense)
    if name != "sdc":
        parser.set_defaults(topology=name)
    else:
        parser.set_defaults(usual_topology=name)
        text = "over a network of your own in place of this one"
        parser.add_argument("--topology", type=topology_name, metavar="FILE.py:CLASS", help=text)


def _call_superdense(arguments: argparse.Namespace) -> int:
    return guarded(partial(superdense.run, superdense_request(arguments)))


def superdense_request(arguments: argparse.Namespace) -> SuperdenseRequest:
    """Return what the command line asks for."""
    return read(
        SuperdenseRequest,
        arguments,
        options=read(SuperdenseOptions, arguments, port=APPLICATION_PORT),
        network=read(NetworkOptions, arguments),
        run=read(RunOptions, arguments),
    )


def _add_service(jobs: Any, name: str, verb: Verb) -> None:
    """Describe a service."""
    parser = jobs.add_parser(name, help=verb.help, description=verb.help)
    parser.put_off(partial(_describe_service, parser, name, verb))


def _describe_service(parser: Parser, name: str, verb: Verb) -> None:
    parser.set_defaults(call=_call_service, service=name)
    if verb.protocols:
        name, *_ = verb.protocols
        text = f"by which photons, or pairs ({name})"
        parser.add_argument(
            "--protocol", dest="service", choices=verb.protocols, default=name, help=text
        )
    add_topology(parser, verb.topology)
    kind = NAMES[name].options
    session = kind(host="", port=SERVICE_PORT)
    add_options(parser, kind, words=_session_words(session, verb))
    rate = f"of the source ({session.rate_hz}, or as fast as the slowest source can)"
    block = f"pairs in a block ({session.block_pairs}, or what is made in {MAX_BLOCK_S:g} s)"
    absent = dict.fromkeys(("eve", "eve_attack", "eve_hides_db"), not verb.eavesdropper)
    absent["schedule"] = absent["purify"] = not verb.scheduled
    absent["sender"], absent["hand_out"] = verb.line, not verb.protocols
    add_options(
        parser,
        ServiceRequest,
        leave_out=[option for option, there_is_none in absent.items() if there_is_none],
        words={"rate_hz": {"help": rate}, "block_pairs": {"help": block}},
    )
    add_options(parser, NetworkOptions, leave_out=() if verb.keys else KEYS)
    add_options(parser, RunOptions)


def _session_words(session: Any, verb: Verb) -> dict[str, Any]:
    """Return how the options of a service's session are said."""
    words = {
        "host": {
            "flag": "--to",
            "default": "bob",
            "metavar": "HOST",
            "help": "that is asked (bob)",
        },
        "count": {"metavar": "N", "help": f"{verb.unit.replace('_', ' ')} ({session.count})"},
        **verb.options,
    }
    if verb.line:
        del words["host"]
    if verb.source:
        text = "host that makes the pairs, perhaps the one that asks (the network's)"
        words["source"] = {"metavar": "HOST", "help": text}
    return words


def _call_service(arguments: argparse.Namespace) -> int:
    return guarded(partial(counted_service.run, service_request(arguments)))


def service_request(arguments: argparse.Namespace) -> ServiceRequest:
    """Return what the command line asks for."""
    kind, ends = NAMES[arguments.service].options, {}
    if verb_of(arguments.service).line:
        first, second, *_others = f"{arguments.line},".split(",")
        arguments, ends = (
            argparse.Namespace(**{**vars(arguments), "sender": first}),
            {"host": second},
        )
    return read(
        ServiceRequest,
        arguments,
        options=read(kind, arguments, port=SERVICE_PORT, **ends),
        network=read(NetworkOptions, arguments),
        run=read(RunOptions, arguments),
    )


def _add_keys(jobs: Any) -> None:
    """Describe the keeping of keys."""
    text = "keep keys of hosts, and deliver them to programs (ETSI GS QKD 014)"
    parser = jobs.add_parser(keys.NAME, help=text, description=text)
    parser.put_off(partial(_describe_keys, parser))


def _describe_keys(parser: Parser) -> None:
    parser.set_defaults(call=_call_keys)
    add_topology(parser)
    for kind in (KeysRequest, KeyServiceOptions, PassingEve, NetworkOptions):
        add_options(parser, kind)
    add_options(parser, RunOptions, leave_out=MACHINES)


def _call_keys(arguments: argparse.Namespace) -> int:
    return guarded(partial(keys.run, keys_request(arguments)))


def keys_request(arguments: argparse.Namespace) -> KeysRequest:
    """Return what the command line asks for."""
    return read(
        KeysRequest,
        arguments,
        keys=read(KeyServiceOptions, arguments),
        eve=read(PassingEve, arguments),
        network=read(NetworkOptions, arguments),
        run=read(RunOptions, arguments),
    )


def _add_vpn(jobs: Any) -> None:
    """Describe the VPN."""
    text = "a VPN whose keys are of light, with a file moving through it"
    parser = jobs.add_parser(vpn.NAME, help=text, description=text)
    parser.put_off(partial(_describe_vpn, parser))


def _describe_vpn(parser: Parser) -> None:
    parser.set_defaults(call=_call_vpn)
    add_topology(parser)
    for kind in (VpnRequest, PassingEve, NetworkOptions):
        add_options(parser, kind)
    add_options(parser, RunOptions, leave_out=MACHINES)


def _call_vpn(arguments: argparse.Namespace) -> int:
    return guarded(partial(vpn.run, vpn_request(arguments)))


def vpn_request(arguments: argparse.Namespace) -> VpnRequest:
    """Return what the command line asks for."""
    return read(
        VpnRequest,
        arguments,
        eve=read(PassingEve, arguments),
        network=read(NetworkOptions, arguments),
        run=read(RunOptions, arguments),
    )
