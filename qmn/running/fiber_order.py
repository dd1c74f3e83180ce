"""Orders about fibres of the running network, as the verbs calibrate and classical give them."""

import argparse
import sys
from typing import Any

import grpc

from qmn.running.network import dispatcher_of_running_network
from qmn.timeouts import ORDER_TIMEOUT_S
from topologies.system.processes.programs import NetworkError
from wire.config import DispatcherConfig
from wire.dispatcher_pb2 import AdjustFiberRequest
from wire.dispatcher_pb2_grpc import DispatcherStub
from wire.dispatcher_service import RUNNER, metadata

NO_CAUSE = (grpc.StatusCode.UNAVAILABLE, grpc.StatusCode.DEADLINE_EXCEEDED)


class BadOrder(Exception):
    """An order that these fibres cannot follow; the text names value and remedy."""


def add_nodes(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("a", metavar="NODE", help="one end of the fibres, as alice")
    parser.add_argument("b", metavar="NODE", help="their other end, as q1")


def give(a: str, b: str, done: str, **adjustment: Any) -> int:
    """Adjust the fibres and say so; turn what is wrong into one line and an exit status."""
    request = AdjustFiberRequest(a=a, b=b, **adjustment)
    try:
        fibers = send(dispatcher_of_running_network(), request)
    except (BadOrder, NetworkError) as error:
        print(f"qmn: {error}", file=sys.stderr)
        return 1
    count = "1 fibre" if fibers == 1 else f"{fibers} fibres"
    print(f"{count} between {a} and {b}: {done}")
    return 0


def send(config: DispatcherConfig, request: AdjustFiberRequest) -> int:
    """Ask the dispatcher; return how many fibres it was."""
    with grpc.insecure_channel(f"unix:{config.socket}") as channel:
        stub = DispatcherStub(channel)  # type: ignore[no-untyped-call]
        try:
            token = metadata(config.tokens[RUNNER])
            reply = stub.AdjustFiber(request, timeout=ORDER_TIMEOUT_S, metadata=token)
        except grpc.RpcError as error:
            if error.code() in NO_CAUSE:
                raise NetworkError(
                    f"the dispatcher at {config.socket} does not answer ({error.details()}); "
                    "has the network ended?"
                ) from error
            raise BadOrder(str(error.details())) from error
    return int(reply.fibers)
