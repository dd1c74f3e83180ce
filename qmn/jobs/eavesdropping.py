"""--eve FRACTION: puts eve on the fibre of a run, and has her measure a fraction of the light."""

import json
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

from controller_apps.policy.policy import DEFAULT
from qmn.network.description import NetworkDescription
from qmn.network.options import NetworkOptions
from qmn.options import BadInput
from qmn.timeouts import START_TIMEOUT_S
from topologies.network import Network
from topologies.programs import Program, python

EVE = "eve"
TOPOLOGY = "tapped"  # that has her
POLICY = "policy.toml"  # in the run's folder


def with_eve(network: NetworkOptions) -> NetworkOptions:
    """Return the network that has eve in place of the default."""
    return replace(network, topology=TOPOLOGY) if network.topology == "sdc" else network


def check(ends: Collection[str], network: NetworkDescription) -> None:
    """Raise BadInput if eve cannot be put on the fibre between these ends."""
    options = network.options
    if EVE not in network.hosts:
        raise BadInput(f"--eve: {options.topology} has no host eve; use --topology {TOPOLOGY}")
    if EVE in ends:
        raise BadInput("--eve: eve is sender or receiver; choose two others")
    if options.policy:
        raise BadInput("--eve makes a policy of its own: leave out --policy")


def tapping_policy(begin: str, end: str, folder: Path) -> Path:
    """Write the policy that puts eve on the fibre from the beginning of light to its end."""
    policy = folder / POLICY
    tap = f"\n[[tap]]\nbetween = {json.dumps((begin, end))}\nby = {json.dumps(EVE)}\n"
    policy.write_text(DEFAULT.read_text() + tap)
    return policy


def sender_of_light(service: str, sender: str, network: NetworkDescription) -> str:
    """Return whose light the receiver measures: the sender's, or the pair source's."""
    return sender if service == "bb84" else network.parts.sources[0]


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
