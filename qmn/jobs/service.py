"""The jobs of services that are about a number of things, as states or pairs: qmn run SERVICE."""

import argparse
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Any

from rich.console import Console

from hosts.middleware.services import NAMES
from hosts.middleware.services.distribution.distribute_options import PROTOCOLS
from hosts.middleware.services.key_distribution.options import BOUNDS, CORRECTIONS, KeyOptions
from hosts.middleware.services.teleportation import qubit_states
from hosts.middleware.session.channel import SessionError
from hosts.middleware.session.service_options import ServiceOptions
from hosts.timeouts import MAX_BLOCK_S
from qmn.jobs import eavesdropping, runner, swap_schedule
from qmn.jobs.run_context import add_run_options, check_run, guarded
from qmn.network.options import (
    BadInput,
    add_key_folder,
    add_network_options,
    check_network,
    check_two_hosts,
)
from qmn.network.topologies import TOPOLOGIES, devices_of, quantum_hosts, topology, topology_name
from topologies.network import Signals, require_root
from wire.features import EMIT
from wire.parameters.physics import Device

SERVICE_PORT = 9
KEYS = KeyOptions(host="", port=SERVICE_PORT)  # by default


@dataclass(frozen=True)
class Verb:
    """A service as the command line has it."""

    help: str
    unit: str  # what --count counts
    options: Mapping[str, dict[str, Any]]  # of the service's own: argparse's words for each
    protocols: tuple[str, ...] = ()  # services that do it; none: the one of the verb's name
    topology: str = "sdc"  # by default
    eavesdropper: bool = False  # whether eve may be put on the fibre
    source: bool = False  # whether the host that makes pairs can be chosen
    scheduled: bool = False  # whether repeaters take turns
    keys: bool = False  # whether it leaves keys


# What the services that leave pairs in memory can be told.
PAIRS: Mapping[str, dict[str, Any]] = MappingProxyType(
    {
        "fidelity": {
            "type": float,
            "default": 0.0,
            "metavar": "F",
            "help": "at least, to Phi+ (0: any)",
        },
        "sample": {
            "type": float,
            "default": 0.1,
            "metavar": "SHARE",
            "help": "of the pairs, sacrificed for the estimate (0.1)",
        },
        "purification": {
            "choices": PROTOCOLS,
            "default": "dejmps",
            "help": "where it is needed (dejmps)",
        },
        "rounds": {
            "type": int,
            "default": None,
            "metavar": "N",
            "help": "of purification (as many as the fidelity needs)",
        },
    }
)
VERBS: Mapping[str, Verb] = MappingProxyType(
    {
        "distribute": Verb(
            "put pairs of a wanted fidelity into the memories of two hosts",
            "pairs",
            PAIRS,
            source=True,
        ),
        "swap": Verb(
            "put pairs into the memories of two hosts by way of repeaters",
            "pairs",
            PAIRS,
            topology="repeaters",
            scheduled=True,
        ),
        "teleport": Verb(
            "teleport states",
            "states",
            {
                "state": {
                    "default": qubit_states.RANDOM,
                    "metavar": "NAME|THETA,PHI",
                    "help": f"each of them: {', '.join(qubit_states.NAMES)} or random (of these "
                    "six); on --backend dense also haar (random on the Bloch sphere) or angles in "
                    "rad, as 1.2,0.5 or pi/3,-pi/4 (random)",
                }
            },
            source=True,
        ),
        "qkd": Verb(
            "distribute secret keys",
            "sifted_bits",
            {
                "correction": {
                    "choices": tuple(CORRECTIONS),
                    "default": KEYS.correction,
                    "help": f"of errors ({KEYS.correction})",
                },
                "max_qber": {
                    "type": float,
                    "default": KEYS.max_qber,
                    "metavar": "Q",
                    "help": f"no key above this error rate ({KEYS.max_qber:g})",
                },
                "test_fraction": {
                    "type": float,
                    "default": KEYS.test_fraction,
                    "metavar": "F",
                    "help": f"of the sifted bits, disclosed ({KEYS.test_fraction:g})",
                },
                "epsilon": {
                    "type": float,
                    "default": KEYS.epsilon,
                    "metavar": "P",
                    "help": f"that the key is not secret, at most ({KEYS.epsilon:g})",
                },
                "bound": {
                    "choices": tuple(BOUNDS),
                    "default": KEYS.bound,
                    "help": f"of the key's length: proven, or that of endless keys ({KEYS.bound})",
                },
            },
            ("bb84", "bbm92"),
            eavesdropper=True,
            keys=True,
        ),
    }
)


def verb_of(service: str) -> Verb:
    """Return how the command line has a service."""
    return next(verb for name, verb in VERBS.items() if service in (name, *verb.protocols))


def add_parsers(jobs: Any) -> None:
    """Describe the services among what `qmn run` can do."""
    for name, verb in VERBS.items():
        parser = jobs.add_parser(name, help=verb.help, description=verb.help)
        parser.set_defaults(call=partial(guarded, run), service=name)
        if verb.protocols:
            name, *_ = verb.protocols
            text = f"by which photons, or pairs ({name})"
            parser.add_argument(
                "--protocol", dest="service", choices=verb.protocols, default=name, help=text
            )
        _add_options(parser, name, verb)


def _add_options(parser: argparse.ArgumentParser, name: str, verb: Verb) -> None:
    add = partial(parser.add_argument)
    defaults = NAMES[name].options(host="", port=SERVICE_PORT)
    names = f"{', '.join(TOPOLOGIES)}, or FILE.py:CLASS"
    text = f"over this network ({names}; default: {verb.topology})"
    add("--topology", type=topology_name, default=verb.topology, metavar="NAME", help=text)
    add("--from", dest="sender", default="alice", metavar="HOST", help="that asks (alice)")
    add("--to", dest="receiver", default="bob", metavar="HOST", help="that is asked (bob)")
    text = f"{verb.unit.replace('_', ' ')} ({defaults.count})"
    add("--count", type=int, default=defaults.count, metavar="N", help=text)
    for option, words in verb.options.items():
        add(f"--{option.replace('_', '-')}", **words)
    parser.set_defaults(eve=None, schedule=None)
    if verb.eavesdropper:
        eavesdropping.add_option(parser)
    if verb.scheduled:
        swap_schedule.add_option(parser)
    text = f"pairs in a block ({defaults.block_pairs}, or what is made in {MAX_BLOCK_S:g} s)"
    add("--block-pairs", type=int, metavar="N", help=text)
    text = f"of the source ({defaults.rate_hz}, or as fast as the slowest source can)"
    add("--rate-hz", type=int, metavar="HZ", help=text)
    parser.set_defaults(source="")
    if verb.source:
        text = "host that makes the pairs, perhaps the one that asks (the network's)"
        add("--source", default="", metavar="HOST", help=text)
    add_network_options(parser)
    if verb.keys:
        add_key_folder(parser)
    add_run_options(parser)


def run(arguments: argparse.Namespace, signals: Signals, console: Console) -> int:
    """Do the whole run and return its exit status."""
    options = check_input(arguments)
    require_root()

    def describe(folder: Path) -> runner.Job:
        eavesdropping.make_policy(arguments, topology(arguments)(), folder)
        swap_schedule.make_policy(arguments, folder)
        return job(arguments, options)

    return runner.run(arguments.service, describe, arguments, signals, console)


def job(arguments: argparse.Namespace, options: ServiceOptions) -> runner.Job:
    """Return the use of a service."""
    service, sender, receiver = arguments.service, arguments.sender, arguments.receiver
    unit = verb_of(service).unit
    named = unit.replace("_", " ")
    return runner.Job(
        service=service,
        options=options,
        opener=sender,
        acceptor=receiver,
        parameters=("sender", "receiver", "eve", "schedule", *own_options(service)),
        said=f"{service} from {sender} to {receiver}: {options.count:,} {named}",
        unit=named,
        total=options.count,
        done=lambda line: line.get(unit, 0),
    )


def own_options(service: str) -> tuple[str, ...]:
    """Return the names of what a service can be told beside where it goes."""
    return ("count", "block_pairs", "rate_hz", "source", *verb_of(service).options)


def check_input(arguments: argparse.Namespace) -> ServiceOptions:
    """Return what the service is told; raise BadInput before anything is started."""
    eavesdropping.choose_topology(arguments)
    topo = topology(arguments)()
    check_two_hosts(arguments.sender, arguments.receiver, quantum_hosts(topo))
    check_source(arguments, quantum_hosts(topo))
    check_network(arguments)
    check_run(arguments)
    eavesdropping.check(arguments, topo)
    fit_light(arguments, devices_of(topo).values())
    swap_schedule.check(arguments)
    fields = {name: getattr(arguments, name) for name in own_options(arguments.service)}
    words = {"host": arguments.receiver, "port": SERVICE_PORT, **fields}
    try:
        options: ServiceOptions = NAMES[arguments.service].options.from_fields(words)
    except SessionError as error:
        raise BadInput(str(error)) from error
    state = fields.get("state", qubit_states.RANDOM)
    if arguments.backend != "dense" and qubit_states.needs_vectors(state):
        raise BadInput(
            f"--state {state} is not a stabiliser state, as --backend {arguments.backend} holds "
            f"them: add --backend dense, or choose {', '.join(qubit_states.NAMES)} or random"
        )
    return options


def check_source(arguments: argparse.Namespace, hosts: Sequence[str]) -> None:
    """Raise BadInput for a source that is not a host."""
    if arguments.source and arguments.source not in hosts:
        raise BadInput(f"--source {arguments.source}: choose one of {', '.join(hosts)}")


def fit_light(arguments: argparse.Namespace, devices: Iterable[Device]) -> None:
    """Choose rate and size of blocks, where none are given, so that every source can make them."""
    defaults = NAMES[arguments.service].options(host="", port=SERVICE_PORT)
    sources = [device.source for device in devices if EMIT in device.features]
    if arguments.rate_hz is None:
        slowest = min((source.max_rate_hz for source in sources), default=defaults.rate_hz)
        arguments.rate_hz = max(1, int(min(defaults.rate_hz, slowest)))
    if arguments.block_pairs is None:
        longest = max(1, int(arguments.rate_hz * MAX_BLOCK_S))
        arguments.block_pairs = min(defaults.block_pairs, longest)
