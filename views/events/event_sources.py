"""Sources of quantum events: the dispatcher of a running network, or the file of a run."""

import os
import time
from collections.abc import Collection, Iterator, Sequence
from itertools import chain
from pathlib import Path
from typing import TypeVar

import grpc

from hosts.quantum_socket import QuantumSocket, QuantumSocketError, StackEnded
from qmn.timeouts import WATCH_POLL_S, WATCH_TIMEOUT_S
from topologies.system.processes.programs import NetworkError
from views.events.unread_events import Unread
from wire.config import DispatcherConfig
from wire.dispatcher_pb2 import Event, WatchRequest
from wire.dispatcher_pb2_grpc import DispatcherStub
from wire.dispatcher_service import CHANNEL_OPTIONS, RUNNER, metadata
from wire.events import decode_record
from wire.pcapng import LINKTYPE_USER0, Reader
from wire.results.run_result import RESULT

T = TypeVar("T")
ENDED = (grpc.StatusCode.UNAVAILABLE, grpc.StatusCode.CANCELLED)


def attached(config: DispatcherConfig, request: WatchRequest) -> Iterator[Event]:
    """Yield events as they happen, until the network ends."""
    return chain.from_iterable(gathered(config, request))


def gathered(config: DispatcherConfig, request: WatchRequest) -> Iterator[Sequence[Event]]:
    """Yield events as they happen, in the groups of the dispatcher, until the network ends.

    The dispatcher keeps a bounded number for a slow reader and says how many it has dropped; those
    that it still keeps when it ends are counted as dropped, too.
    """
    with grpc.insecure_channel(f"unix:{config.socket}", options=CHANNEL_OPTIONS) as channel:
        try:
            grpc.channel_ready_future(channel).result(WATCH_TIMEOUT_S)
        except grpc.FutureTimeoutError as error:
            raise NetworkError(
                f"the dispatcher at {config.socket} does not answer in {WATCH_TIMEOUT_S:g} s; "
                "has the network ended?"
            ) from error
        stub = DispatcherStub(channel)  # type: ignore[no-untyped-call]
        stream = stub.Watch(request, metadata=metadata(config.tokens[RUNNER]))
        with Unread(Path(config.event_capture or os.devnull), request, time.time_ns()) as unread:
            try:
                for group in stream:
                    for event in group.events:
                        unread.read(event)
                    yield group.events
            except grpc.RpcError as error:
                if error.code() not in ENDED:
                    raise NetworkError(f"the dispatcher ended it: {error.details()}") from error
                yield list(filter(None, [unread.end()]))
            finally:
                stream.cancel()


def through_stack(stack: str, session: int, history: bool, follow: bool) -> Iterator[Event]:
    """Yield what happens at one host, as its stack tells an application, until the network ends.

    Without `follow` only what is remembered, if `history` asks for that.

    Events that the dispatcher still keeps for a slow reader then are lost, and not counted:
    a host cannot read the file of the run.
    """
    try:
        with QuantumSocket(stack) as quantum_socket:
            yield from quantum_socket.watch(session, history, follow)
    except StackEnded:
        return
    except QuantumSocketError as error:
        raise NetworkError(str(error)) from error


def recorded(file: Path, follow: bool) -> Iterator[Event]:
    """Yield the events of a run's file; if following, also new ones until the run has ended."""
    result = file.resolve().with_name(RESULT)
    with file.open("rb") as opened:
        reader = Reader(opened)
        while True:
            ended = not follow or result.exists()  # before the file is read to its end
            for packet in reader.packets():
                if reader.interfaces[packet.interface].link_type == LINKTYPE_USER0:
                    yield decode_record(packet.data)
            if ended:
                return
            time.sleep(WATCH_POLL_S)


def single(chosen: Collection[T] | None, every: T) -> T:
    return next(iter(chosen)) if chosen and len(chosen) == 1 else every
