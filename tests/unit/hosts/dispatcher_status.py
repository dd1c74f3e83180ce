"""The status of a dispatcher, as the runner may ask for it."""

import time
from collections.abc import Sequence
from pathlib import Path

import grpc

from wire.dispatcher_pb2 import HeldBlock, StatusReply, StatusRequest
from wire.dispatcher_pb2_grpc import DispatcherStub
from wire.dispatcher_service import metadata

HOSTS = ("alice", "bob", "charlie")


def status(folder: Path, node: str) -> StatusReply:
    """Return what the dispatcher knows of a node."""
    with grpc.insecure_channel(f"unix:{folder / 'dispatcher.sock'}") as channel:
        stub = DispatcherStub(channel)  # type: ignore[no-untyped-call]
        reply: StatusReply = stub.Status(
            StatusRequest(blocks_at=node), metadata=metadata("token of runner"), timeout=5
        )
        return reply


def require_nothing_left(folder: Path, nodes: Sequence[str] = HOSTS) -> None:
    """Wait until all hosts have let go of all photons."""
    deadline = time.monotonic() + 5
    while any(status(folder, node).blocks for node in nodes) or status(folder, "").live_qubits:
        assert time.monotonic() < deadline, [status(folder, node) for node in nodes]
        time.sleep(0.02)


def held(folder: Path, node: str) -> list[HeldBlock]:
    """Return the blocks at a node of which photons are left."""
    return [block for block in status(folder, node).blocks if block.photons]
