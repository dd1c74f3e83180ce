"""qmn link NODE NODE down|up: cut all fibres and copper between two nodes, or mend them.

As Mininet's command `link`, from another terminal. A fibre is cut at its switch; the command ends
when the controller has heard of it, so that the next session finds it so.
"""

import argparse
import subprocess
import sys
from functools import partial
from pathlib import Path
from typing import Any

from qmn.needs import Needs
from qmn.running.controller_console import NoAnswer, ask
from qmn.running.network import announced_network
from qmn.timeouts import ORDER_TIMEOUT_S
from topologies.networks.heard_orders import ends_between, until_heard
from topologies.system.processes.programs import NetworkError
from wire import typed_json
from wire.parameters.checks import remedy
from wire.results.network_facts import NetworkFacts

INTERFACES = Path("/sys/class/net")


def add_parser(verbs: Any) -> None:
    parser = verbs.add_parser("link", description=__doc__)
    parser.add_argument("a", metavar="NODE", help="one end of the links, as alice")
    parser.add_argument("b", metavar="NODE", help="their other end, as q1")
    parser.add_argument("state", metavar="down|up", choices=["down", "up"])
    parser.set_defaults(call=call, needs=Needs.RUNNING)


def call(arguments: argparse.Namespace) -> int:
    """Cut or mend; turn what is wrong into one line and an exit status."""
    a, b, state = arguments.a, arguments.b, arguments.state
    try:
        network = announced_network()
        facts = typed_json.read(NetworkFacts, network.network)
        names = switch_ends(facts, a, b)
        ends = ends_between(a, b, facts.fibers, network.datapath_ids)
        with until_heard(partial(ask, "paths"), ends, state == "up", network.heard_in_s):
            for name in names:
                command = ["ip", "link", "set", name, state]
                subprocess.run(command, check=True, capture_output=True, timeout=ORDER_TIMEOUT_S)
    except (NetworkError, NoAnswer) as error:
        print(f"qmn: {error}", file=sys.stderr)
        return 1
    except subprocess.TimeoutExpired:
        print(f"qmn: `{' '.join(command)}` did not end in {ORDER_TIMEOUT_S:g} s", file=sys.stderr)
        return 1
    except subprocess.CalledProcessError as error:
        print(f"qmn: {error.stderr.decode().strip()}", file=sys.stderr)
        return 1
    print(f"{a} to {b}: {', '.join(names)} {state}")
    return 0


def switch_ends(facts: NetworkFacts, a: str, b: str) -> list[str]:
    """Return the interfaces of switches on the links between two nodes; raise NetworkError."""
    known = {name for fiber in facts.fibers for name in (fiber.a.node, fiber.b.node)}
    known |= {name for link in facts.copper for name in (link[0], link[2])}
    for node in (a, b):
        if node not in known:
            raise NetworkError(f"unknown node {node!r}: {remedy(node, sorted(known))}")
    found = []
    for fiber in facts.fibers:
        if {fiber.a.node, fiber.b.node} == {a, b}:
            ends = [end for end in (fiber.a, fiber.b) if end.port.isdecimal()]
            found += [f"{end.node}-eth{end.port}" for end in ends[:1]]
    for node1, name1, node2, name2 in facts.copper:
        if {node1, node2} == {a, b}:
            found.append(name2 if node1 in facts.addresses else name1)
    if not found:
        raise NetworkError(f"no link between {a} and {b} ends at a switch")
    missing = [name for name in found if not (INTERFACES / name).exists()]
    if missing:
        raise NetworkError(f"there is no interface {missing[0]} any more")
    return found
