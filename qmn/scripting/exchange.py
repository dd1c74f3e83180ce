"""One message between two hosts of a running network, by sockets that this process opens there."""

import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from typing import Any

from hosts.applications.carrying import CHUNK_BYTES
from hosts.quantum_socket import QuantumSocket, QuantumSocketError
from qmn.jobs.transfer import TransferError, with_elements
from qmn.requests.service_verbs import APPLICATION_PORT
from qmn.scripting.tables import Tabular
from qmn.timeouts import STALL_TIMEOUT_S
from topologies.networks.network import Network
from wire.network_time import NetworkTime

READ_BYTES = 1 << 16
Ends = tuple[QuantumSocket, QuantumSocket]  # the sender's, the receiver's
COUNTS = ("bell_pairs", "lost_pairs", "received_symbols", "symbol_errors", "repeated_frames")


@dataclass(frozen=True)
class Exchange(Tabular):
    """What became of a message, and what it took."""

    data: bytes  # as it was received; empty if it was not kept
    size: int  # bytes received, each of which was verified
    setup_s: (
        float  # of the network, from the request to the open light path, as the application sees it
    )
    elapsed_s: float  # of the network, from the open light path until every byte was verified
    bell_pairs: int
    lost_pairs: int
    received_symbols: int
    symbol_errors: int  # before any code or repetition has put them right
    repeated_frames: int

    @property
    def symbol_error_rate(self) -> float | None:
        """Wrong symbols in received ones; None if none was received."""
        return self.symbol_errors / self.received_symbols if self.received_symbols else None

    @property
    def loss(self) -> float:
        """Lost pairs in all pairs."""
        return self.lost_pairs / self.bell_pairs if self.bell_pairs else 0.0

    @property
    def pairs_per_s(self) -> float:
        """Bell pairs used in a second of sending."""
        return self.bell_pairs / max(self.elapsed_s, 1e-9)

    @property
    def bits_per_s(self) -> float:
        """Bits of the message in a second of sending."""
        return 8 * self.size / max(self.elapsed_s, 1e-9)


def exchange(
    network: Network, sender: str, receiver: str, parts: Iterable[bytes], keep: bool, **options: Any
) -> Exchange:
    """Send the parts; `options` are those of QuantumSocket.connect.

    Raise TransferError if not all arrived, NetworkError if the network failed.
    """
    opening = connection(network, sender, receiver, **options)
    chunk = CHUNK_BYTES[options.get("handshake", "framed")]
    return carried(opening, parts, keep, network.runtime.time, chunk)


def carried(
    opening: AbstractContextManager[Ends],
    parts: Iterable[bytes],
    keep: bool,
    network_time: NetworkTime,
    chunk: int = CHUNK_BYTES["framed"],
) -> Exchange:
    """Open a session, and send the parts in pieces of at most `chunk` bytes."""
    received, size = bytearray(), 0

    def take(data: bytes) -> None:
        nonlocal size
        size += len(data)
        if keep:
            received.extend(data)

    asked = time.monotonic()
    with ThreadPoolExecutor(1) as pool, opening as (sending, receiving):
        opened = time.monotonic()
        reading = pool.submit(_read, receiving, take)
        for part in parts:
            for start in range(0, len(part), chunk):
                sending.sendall(part[start : start + chunk])
        sending.shutdown()
        reading.result(network_time.wall_s(STALL_TIMEOUT_S))
        ended = time.monotonic()
    used = sending.statistics
    return Exchange(
        bytes(received),
        size,
        setup_s=network_time.network_s(opened - asked),
        elapsed_s=network_time.network_s(ended - opened),
        **{name: used[name] for name in COUNTS},
    )


def _read(receiving: QuantumSocket, take: Callable[[bytes], None]) -> None:
    while data := receiving.recv(READ_BYTES):
        take(data)


@contextmanager
def ends(
    stack: Callable[[str], str], sender: str, receiver: str, limit_s: float, **options: Any
) -> Iterator[Ends]:
    """Open a session, and yield both its ends; `stack` says where that of a host listens.

    Raise QuantumSocketError if it is refused or breaks, TimeoutError without progress.
    """
    with QuantumSocket(stack(receiver)) as listener, QuantumSocket(stack(sender)) as sending:
        for each in (listener, sending):
            each.settimeout(limit_s)
        listener.listen(APPLICATION_PORT)
        sending.connect((receiver, APPLICATION_PORT), **options)
        receiving, _peer = listener.accept()
        with receiving:  # what waits for it, waits no more
            yield sending, receiving


@contextmanager
def connection(network: Network, sender: str, receiver: str, **options: Any) -> Iterator[Ends]:
    """Open a session, and yield both its ends.

    Raise TransferError if it is refused or breaks, NetworkError if the network failed.
    """
    limit_s = network.runtime.time.wall_s(STALL_TIMEOUT_S)
    try:
        with ends(network.runtime.socket, sender, receiver, limit_s, **options) as both:
            yield both
    except (QuantumSocketError, TimeoutError) as error:
        network.explain()
        if isinstance(error, TimeoutError):
            text = f"{sender} to {receiver}: no progress for {limit_s:g} s"
        else:
            text = with_elements(network, str(error))
        raise TransferError(text) from error
