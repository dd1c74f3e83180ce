"""--eve FRACTION: puts eve on the fibre of a run, and has her measure a fraction of the light."""

import argparse
import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from mininet.topo import Topo

from controller_apps.policy.policy import DEFAULT
from qmn.jobs.transfer import START_TIMEOUT_S
from qmn.network.options import BadInput, check_range
from qmn.network.topologies import quantum_hosts
from topologies.network import Network
from topologies.programs import Program, python

EVE = "eve"
TOPOLOGY = "tapped"  # that has her
POLICY = "policy.toml"  # in the run's folder


def add_option(parser: argparse.ArgumentParser) -> None:
    """Describe the option."""
    text = "put eve on the fibre, who measures this fraction of the photons and resends them"
    parser.add_argument("--eve", type=float, default=None, metavar="FRACTION", help=text)


def choose_topology(arguments: argparse.Namespace) -> None:
    """Take the topology that has eve in place of the default."""
    if arguments.eve is not None and arguments.topology == "sdc":
        arguments.topology = TOPOLOGY


def check(arguments: argparse.Namespace, topo: Topo) -> None:
    """Raise BadInput if eve cannot be put on the fibre."""
    if arguments.eve is None:
        return
    check_range(arguments, "eve", 0, 1)
    if EVE not in quantum_hosts(topo):
        raise BadInput(f"--eve: {arguments.topology} has no host eve; use --topology {TOPOLOGY}")
    if EVE in (arguments.sender, arguments.receiver):
        raise BadInput("--eve: eve is sender or receiver; choose two others")
    if arguments.policy is not None:
        raise BadInput("--eve makes a policy of its own: leave out --policy")


def make_policy(arguments: argparse.Namespace, topo: Topo, folder: Path) -> None:
    """Write the policy that puts eve on the fibre to the receiver, and let it be in force."""
    if arguments.eve is None:
        return
    between = sender_of_light(arguments, topo), arguments.receiver
    arguments.policy = folder / POLICY
    tap = f"\n[[tap]]\nbetween = {json.dumps(between)}\nby = {json.dumps(EVE)}\n"
    arguments.policy.write_text(DEFAULT.read_text() + tap)


def sender_of_light(arguments: argparse.Namespace, topo: Topo) -> str:
    """Return whose light the receiver measures: the sender's, or the pair source's."""
    if arguments.service == "bb84":
        return str(arguments.sender)
    return next(str(host) for host in topo.hosts() if topo.nodeInfo(host).get("source"))


@contextmanager
def eavesdropping(
    network: Network, fraction: float | None, facts: dict[str, Any]
) -> Iterator[None]:
    """Have eve intercept meanwhile, if a fraction is given; add what she saw to the facts."""
    if fraction is None:
        yield
        return
    command = [python(), "-m", "hosts.applications.intercept", "--stack"]
    eve = network.run_on(EVE, EVE, [*command, network.runtime.socket(EVE), str(fraction)])
    eve.wait_for("intercepting", START_TIMEOUT_S)
    try:
        yield
    finally:
        eve.stop()
        facts["eve"] = summary_of(eve)


def summary_of(eve: Program) -> dict[str, Any]:
    """Return what she said at her end; nothing if she was ended before."""
    for line in eve.log.read_text(errors="replace").splitlines():
        if line.startswith('{"event": "done"'):
            fields: dict[str, Any] = json.loads(line)
            del fields["event"]
            return fields
    return {}
