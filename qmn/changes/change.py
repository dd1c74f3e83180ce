"""How a change reaches the running network, and how its outcome is printed."""

import sys
from collections.abc import Callable
from typing import Any

import grpc

from programs.network_waits import NetworkWaits
from qmn.running.controller_console import NoAnswer
from qmn.timeouts import ORDER_TIMEOUT_S
from topologies.system.processes.programs import NetworkError
from wire.config import DispatcherConfig
from wire.dispatcher_pb2_grpc import DispatcherStub
from wire.dispatcher_service import RUNNER, metadata

NO_CAUSE = (grpc.StatusCode.UNAVAILABLE, grpc.StatusCode.DEADLINE_EXCEEDED)


class BadChange(Exception):
    """A change that this network cannot have; the text names value and remedy."""


def reported(change: Callable[[], str]) -> int:
    """Make the change and print its outcome, or one line of error; return the exit status."""
    try:
        print(change())
    except (BadChange, NetworkError, NoAnswer) as error:
        print(f"qmn: {error}", file=sys.stderr)
        return 1
    return 0


def ask_dispatcher(
    config: DispatcherConfig,
    call: str,
    request: Any,
    timeout_s: float = ORDER_TIMEOUT_S,
    takes_time: bool = False,
) -> Any:
    """Return the dispatcher's reply; raise BadChange if it refuses, NetworkError if it is gone.

    Stepped time stands meanwhile, unless the reply comes after a time of the network.
    """
    with (
        NetworkWaits(config.time) as waits,
        grpc.insecure_channel(f"unix:{config.socket}") as channel,
    ):
        if not takes_time:
            waits.hold()  # what gRPC carries the gate cannot see
        stub = DispatcherStub(channel)  # type: ignore[no-untyped-call]
        token = metadata(config.tokens[RUNNER])
        try:
            return getattr(stub, call)(request, timeout=timeout_s, metadata=token)
        except grpc.RpcError as error:
            if error.code() in NO_CAUSE:
                raise NetworkError(
                    f"the dispatcher at {config.socket} does not answer ({error.details()}); "
                    "has the network ended?"
                ) from error
            raise BadChange(str(error.details())) from error
