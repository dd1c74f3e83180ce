"""The status of a dispatcher, as the runner may ask for it."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import grpc
from limits import SOON_S, wait_until

from wire.dispatcher_pb2 import HeldBlock, StatusReply, StatusRequest
from wire.dispatcher_pb2_grpc import DispatcherStub
from wire.dispatcher_service import metadata

HOSTS = ("alice", "bob", "charlie")


Ask = Callable[[str], StatusReply]


@contextmanager
def asking(folder: Path) -> Iterator[Ask]:
    """Give what asks the dispatcher what it knows of a node, over one connection."""
    with grpc.insecure_channel(f"unix:{folder / 'dispatcher.sock'}") as channel:
        stub = DispatcherStub(channel)  # type: ignore[no-untyped-call]

        def ask(node: str) -> StatusReply:
            reply: StatusReply = stub.Status(
                StatusRequest(blocks_at=node), metadata=metadata("token of runner"), timeout=SOON_S
            )
            return reply

        yield ask


def status(folder: Path, node: str) -> StatusReply:
    """Return what the dispatcher knows of a node."""
    with asking(folder) as ask:
        return ask(node)


def require_nothing_left(folder: Path, nodes: Sequence[str] = HOSTS) -> None:
    """Wait until all hosts have let go of all photons."""
    with asking(folder) as ask:
        wait_until(
            lambda: not (any(ask(node).blocks for node in nodes) or ask("").live_qubits),
            "no photon is left",
        )


def held(folder: Path, node: str) -> list[HeldBlock]:
    """Return the blocks at a node of which photons are left."""
    return [block for block in status(folder, node).blocks if block.photons]
