"""qmn send HOST HOST TEXT: send a text between two hosts of the running network, as light."""

import argparse
import sys
from typing import Any

from hosts.quantum_socket import QuantumSocketError
from qmn.needs import Needs
from qmn.running.network import announced_network
from qmn.scripting.exchange import carried
from qmn.timeouts import STALL_TIMEOUT_S
from topologies.system.processes.programs import NetworkError
from wire.network_time import NetworkTime
from wire.parameters.checks import remedy


def add_parser(verbs: Any) -> None:
    parser = verbs.add_parser("send", description=__doc__)
    parser.add_argument("sender", metavar="HOST", help="that sends, as alice")
    parser.add_argument("receiver", metavar="HOST", help="that receives, as bob")
    parser.add_argument("text", metavar="TEXT", help="to be sent")
    parser.set_defaults(call=call, needs=Needs.RUNNING)


def call(arguments: argparse.Namespace) -> int:
    """Send, and say what has arrived; turn what is wrong into one line and an exit status."""
    try:
        print(sent(arguments.sender, arguments.receiver, arguments.text))
    except (NetworkError, QuantumSocketError) as error:
        print(f"qmn: {error}", file=sys.stderr)
    except TimeoutError:
        ends = f"{arguments.sender} to {arguments.receiver}"
        print(f"qmn: {ends}: no progress for {STALL_TIMEOUT_S:g} s", file=sys.stderr)
    else:
        return 0
    return 1


def sent(sender: str, receiver: str, text: str) -> str:
    """Send a text; return what a person shall read."""
    network = announced_network()
    for host in (sender, receiver):
        if host not in network.stacks:
            raise NetworkError(f"unknown host {host!r}: {remedy(host, network.stacks)}")
    if sender == receiver:
        raise NetworkError(f"{sender} to itself: choose two hosts")
    stacks, scale = network.stacks.__getitem__, NetworkTime(network.time_scale)
    done = carried(stacks, (sender, receiver), [text.encode()], True, scale)
    received = done.data.decode()
    return f"{receiver} received {received!r} from {sender} with {done.bell_pairs} pairs"
