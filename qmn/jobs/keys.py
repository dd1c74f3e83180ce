"""qmn run keys: hosts keep their key stores filled, and deliver keys by ETSI GS QKD 014."""

import argparse
import time
from functools import partial
from typing import Any

from rich.console import Console

from qmn.jobs import moments, passing_eavesdropper
from qmn.jobs.eavesdropping import choose_topology, sender_of_light
from qmn.jobs.moments import Moments
from qmn.jobs.passing_eavesdropper import PassingEavesdropper
from qmn.jobs.run_context import (
    add_run_options,
    begin_folder,
    check_run,
    ending,
    guarded,
    known_facts,
    running_network,
)
from qmn.network.key_options import add_key_service_options, key_service
from qmn.network.options import (
    BadInput,
    add_key_folder,
    add_network_options,
    check_network,
    check_range,
)
from qmn.network.topologies import TOPOLOGIES, quantum_hosts, topology, topology_name
from qmn.results import result
from topologies.key_managers import KeyManagers, KeyService, application_name, start_key_managers
from topologies.network import Interrupted, Network, Signals, require_root
from topologies.programs import POLL_S

NAME = "keys"
PARAMETERS = ("key_pair", "low_mark", "high_mark", "session_bits", "key_protocol", "keys_per_s")
EVES = ("eve", "at", "until")
MOST_S = 30 * 86_400.0


def add_parser(jobs: Any) -> None:
    """Describe the job."""
    text = "keep keys of hosts, and deliver them to programs (ETSI GS QKD 014)"
    parser = jobs.add_parser(NAME, help=text, description=text)
    parser.set_defaults(call=partial(guarded, run), service="bb84")
    text = f"over this network ({', '.join(TOPOLOGIES)}, or FILE.py:CLASS; default: sdc)"
    add = parser.add_argument
    add("--topology", type=topology_name, default="sdc", metavar="NAME", help=text)
    add("--seconds", type=float, metavar="S", help="end after so long (when Ctrl-C comes)")
    add_key_service_options(parser, always=True)
    passing_eavesdropper.add_options(parser)
    add_network_options(parser)
    add_key_folder(parser)
    add_run_options(parser)


def check_input(arguments: argparse.Namespace) -> KeyService:
    """Return what key managers are to do; raise BadInput before anything is started."""
    choose_topology(arguments)
    topo = topology(arguments)()
    service = key_service(arguments, quantum_hosts(topo))
    assert service is not None  # a pair is the default
    arguments.service = service.link.protocol
    # She is put between the first two.
    arguments.sender, arguments.receiver = service.pairs[0]
    passing_eavesdropper.check(arguments, topo)
    if arguments.seconds is not None:
        check_range(arguments, "seconds", 0.1, MOST_S)
    check_network(arguments)
    check_run(arguments)
    if service.certificates is not None and not service.certificates.is_dir():
        raise BadInput(f"--certificates {service.certificates} is no folder")
    return service


def run(arguments: argparse.Namespace, signals: Signals, console: Console) -> int:
    """Do the whole run and return its exit status."""
    service = check_input(arguments)
    require_root()
    folder = begin_folder(arguments.runs, NAME)
    light_from = sender_of_light(arguments, topology(arguments)())
    eve = PassingEavesdropper(arguments, folder, light_from)
    own = (*PARAMETERS, *(EVES if arguments.eve is not None else ()))
    facts = {"service": NAME, **known_facts(arguments, own), "delivered": False}
    with ending(folder, facts, result.complete):
        with running_network(arguments, folder, facts, signals, console) as network:
            managers = start_key_managers(network, service)
            introduce(console, managers)
            noted = Moments(managers.programs, network.runtime.time, partial(show, console))
            facts["moments"] = noted.all
            watch(network, noted, eve, arguments.seconds)
            facts["asking"] = moments.summary(noted.all, noted.now_s)
        facts["delivered"] = facts["asking"]["keys"] > 0
    result.show(console, facts, folder)
    return 0 if facts["delivered"] else 1


def watch(
    network: Network, noted: Moments, eve: PassingEavesdropper, seconds: float | None
) -> None:
    """Gather what happens until the time is over, or somebody ends a run that has no end."""
    try:
        while seconds is None or noted.now_s < seconds:
            network.check()
            noted.gather()
            eve.look(network, noted)
            time.sleep(POLL_S)
    except Interrupted:
        if seconds is not None:
            raise
    noted.gather()


def introduce(console: Console, managers: KeyManagers) -> None:
    """Say where keys are to be had, and how."""
    for host, url in managers.urls.items():
        console.print(f"{host}: {url}/api/v1/keys/..., as {application_name(host)}")
    console.print(f"certificates: {managers.authority.parent}", soft_wrap=True)


def show(console: Console, moment: moments.Moment) -> None:
    """Print what an opener of sessions or the run itself has said."""
    if moment.get("opened", True):
        console.print(moments.words(moment), soft_wrap=True, markup=False)
