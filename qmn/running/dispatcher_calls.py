"""Calls of the runner to the dispatcher of a network that this process has started."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import grpc

from programs.network_waits import NetworkWaits
from qmn.timeouts import DISPATCHER_TIMEOUT_S
from topologies.networks.network import Network
from topologies.system.processes.programs import NetworkError
from topologies.system.runs.runtime import DISPATCHER
from wire.dispatcher_pb2 import (
    AdjustMemoryRequest,
    HeldBlock,
    StatusReply,
    StatusRequest,
    SwitchCondition,
    SwitchStatisticsReply,
    SwitchStatisticsRequest,
    WatchSwitchRequest,
)
from wire.dispatcher_pb2_grpc import DispatcherStub
from wire.dispatcher_service import RUNNER, metadata


@contextmanager
def _asking(network: Network) -> Iterator[tuple[Any, dict[str, Any]]]:
    """Yield a stub and the options of a call; raise NetworkError if it is not answered."""
    runtime = network.runtime
    options = {"timeout": DISPATCHER_TIMEOUT_S, "metadata": metadata(runtime.token(RUNNER))}
    with (
        NetworkWaits(runtime.time) as waits,
        grpc.insecure_channel(f"unix:{runtime.socket(DISPATCHER)}") as channel,
    ):
        waits.hold()  # what gRPC carries the gate cannot see
        try:
            yield DispatcherStub(channel), options  # type: ignore[no-untyped-call]
        except grpc.RpcError as error:
            network.check()  # what died in the network is the cause
            raise NetworkError(f"the dispatcher does not answer ({error.details()})") from error


def status(network: Network) -> StatusReply:
    with _asking(network) as (stub, options):
        reply: StatusReply = stub.Status(StatusRequest(), **options)
    return reply


def held_blocks(network: Network, node: str) -> list[HeldBlock]:
    with _asking(network) as (stub, options):
        reply: StatusReply = stub.Status(StatusRequest(blocks_at=node), **options)
    return list(reply.blocks)


def switch_statistics(network: Network) -> dict[str, SwitchStatisticsReply]:
    with _asking(network) as (stub, options):
        return {
            name: stub.SwitchStatistics(SwitchStatisticsRequest(switch=name), **options)
            for name in network.runtime.switches
        }


def adjust_memories(network: Network, changes: Mapping[str, Mapping[str, float]]) -> None:
    """Change settings of memories of hosts and switches, by their names."""
    with _asking(network) as (stub, options):
        for name, settings in changes.items():
            stub.AdjustMemory(AdjustMemoryRequest(node=name, settings=settings), **options)


def switch_conditions(network: Network) -> dict[str, SwitchCondition]:
    with _asking(network) as (stub, options):
        conditions = {}
        for name in network.runtime.switches:
            stream = stub.WatchSwitch(WatchSwitchRequest(switch=name), **options)
            conditions[name] = next(iter(stream))
            stream.cancel()
    return conditions
