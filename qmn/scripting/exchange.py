"""One message between two hosts of a running network, sent and received by this process."""

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from hosts.applications.carrying import CHUNK_BYTES
from hosts.client import BlockingSession, blocking_session
from hosts.stack_socket import BYTES, QuantumSocketError
from qmn.jobs.transfer import TransferError, with_elements
from qmn.requests.service_verbs import APPLICATION_PORT
from qmn.scripting.tables import Tabular
from qmn.timeouts import STALL_TIMEOUT_S
from topologies.networks.network import Network
from wire.network_time import NetworkTime

COUNTS = ("bell_pairs", "lost_pairs", "received_symbols", "symbol_errors", "repeated_frames")


@dataclass(frozen=True)
class Exchange(Tabular):
    """The outcome of a message, and its cost."""

    data: bytes  # as it was received; empty if it was not kept
    size: int  # bytes received, each of which was verified
    setup_s: float  # of the network, from the request to the open light path, for applications
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
    with explained(network, sender, receiver):
        stacks, time_ = network.runtime.socket, network.runtime.time
        return carried(stacks, (sender, receiver), parts, keep, time_, **options)


def carried(
    stacks: Callable[[str], str],
    ends: tuple[str, str],
    parts: Iterable[bytes],
    keep: bool,
    network_time: NetworkTime,
    **options: Any,
) -> Exchange:
    """Send the parts over a session, in pieces that its handshake takes at a time.

    Raise QuantumSocketError if it is refused or breaks, TimeoutError without progress.
    """
    received, size = bytearray(), 0
    chunk = CHUNK_BYTES[options.get("handshake", "framed")]

    def take(data: bytes) -> None:
        nonlocal size
        size += len(data)
        if keep:
            received.extend(data)

    asked_s = network_time.now_s()
    with opened(stacks, ends, network_time, take=take, **options) as session:
        ready_s = network_time.now_s()
        for part in parts:
            for start in range(0, len(part), chunk):
                session.sendall(part[start : start + chunk])
        session.end()
        ended_s = network_time.now_s()
    return Exchange(
        bytes(received),
        size,
        setup_s=ready_s - asked_s,
        elapsed_s=ended_s - ready_s,
        **{name: session.summary[name] for name in COUNTS},
    )


@contextmanager
def opened(
    stacks: Callable[[str], str], ends: tuple[str, str], network_time: NetworkTime, **options: Any
) -> Iterator[BlockingSession]:
    """Open a session that carries bytes; `stacks` gives the socket of a host's stack."""
    options["limit_s"] = STALL_TIMEOUT_S
    port = APPLICATION_PORT
    with blocking_session(stacks, BYTES, ends, port, network_time, **options) as session:
        session.results()
        yield session


@contextmanager
def explained(network: Network, sender: str, receiver: str) -> Iterator[None]:
    """Raise TransferError for a session that fails, NetworkError if the network has failed."""
    try:
        yield
    except TimeoutError as error:
        network.explain()
        limit_s = network.runtime.time.wall_s(STALL_TIMEOUT_S)
        raise TransferError(f"{sender} to {receiver}: no progress for {limit_s:g} s") from error
    except QuantumSocketError as error:
        network.explain()
        raise TransferError(with_elements(network, str(error))) from error
