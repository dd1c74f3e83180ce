"""Cut all fibres and copper between two nodes, or mend them.

As Mininet's command `link`, from another terminal. A fibre is cut at its switch; the command ends
when the controller has heard of it, so that the next session finds it so.
"""

import argparse
from functools import partial
from pathlib import Path

from qmn.changes.change import reported
from qmn.running.controller_console import ask
from qmn.running.network import announced_network
from topologies.networks.heard_orders import ends_between, until_heard
from topologies.system.processes.commands import ip
from topologies.system.processes.programs import NetworkError
from wire import typed_json
from wire.parameters.checks import remedy
from wire.results.run_result import NetworkFacts

INTERFACES = Path("/sys/class/net")


def describe(parser: argparse.ArgumentParser) -> None:
    parser.description = __doc__
    parser.add_argument("a", metavar="NODE", help="one end of the links, as alice")
    parser.add_argument("b", metavar="NODE", help="their other end, as q1")
    parser.add_argument("state", metavar="down|up", choices=["down", "up"], help="what to do")
    parser.set_defaults(call=call)


def call(arguments: argparse.Namespace) -> int:
    return reported(partial(set_links, arguments.a, arguments.b, arguments.state))


def set_links(a: str, b: str, state: str) -> str:
    """Cut or mend, and wait for the controller; return the outcome in words."""
    network = announced_network()
    facts = typed_json.read(NetworkFacts, network.network)
    names = switch_ends(facts, a, b)
    ends = ends_between(a, b, facts.fibers, network.datapath_ids)
    with until_heard(partial(ask, "paths"), ends, state == "up", network.heard_in_s):
        ip(f"link set {name} {state}" for name in names)
    return f"{a} to {b}: {', '.join(names)} {state}"


def switch_ends(facts: NetworkFacts, a: str, b: str) -> list[str]:
    """Return the interfaces of switches on the links between two nodes; raise NetworkError."""
    known = {name for fiber in facts.fibers for name in (fiber.a.node, fiber.b.node)}
    known |= {name for link in facts.copper for name in (link[0], link[2])}
    for node in (a, b):
        if node not in known:
            raise NetworkError(f"unknown node {node!r}: {remedy(node, sorted(known))}")
    names = []
    for fiber in facts.fibers:
        if {fiber.a.node, fiber.b.node} == {a, b}:
            ends = [end for end in (fiber.a, fiber.b) if end.port.isdecimal()]
            names += [f"{end.node}-eth{end.port}" for end in ends[:1]]
    for node1, name1, node2, name2 in facts.copper:
        if {node1, node2} == {a, b}:
            names.append(name2 if node1 in facts.addresses else name1)
    if not names:
        raise NetworkError(f"no link between {a} and {b} ends at a switch")
    missing = [name for name in names if not (INTERFACES / name).exists()]
    if missing:
        raise NetworkError(f"there is no interface {missing[0]} any more")
    return names
