"""Networks in which demos use services, as applications on hosts do."""

from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mininet.topo import Topo

from evidence.curves.experiment import Experiment, SweepError
from evidence.curves.parameters import Values
from hosts.quantum_socket import QuantumSocketError
from hosts.service_socket import ServiceSocket
from qmn.network.custom_topology import BadTopology
from qmn.options import BadInput
from qmn.requests.service_verbs import SERVICE_PORT
from qmn.results.run_folder import begin_folder
from qmn.scripting.network import QuantumNetwork, start
from qmn.timeouts import STALL_TIMEOUT_S
from topologies.system.processes.programs import NetworkError

Results = Iterator[dict[str, Any]]


@contextmanager
def network_for(
    experiment: Experiment,
    values: Values,
    runs: Path,
    topology: str | Callable[[], Topo],
    **options: Any,
) -> Iterator[QuantumNetwork]:
    """Start a network for a point; raise SweepError for all that goes wrong in it."""
    try:
        folder = begin_folder(runs, experiment.name)
        with start(topology, folder, **options) as network:
            yield network
    except (NetworkError, QuantumSocketError, TimeoutError, BadInput, BadTopology) as error:
        raise SweepError(f"{experiment.place(values)} failed: {error}") from error


@dataclass(frozen=True)
class Asked:
    """A session that one host has asked another for."""

    asking: ServiceSocket
    results: Results  # of the opener
    _there: "Future[ServiceSocket]"
    _limit_s: float

    @property
    def asked(self) -> ServiceSocket:
        """The acceptor's socket, when it has heard all until the session is over, or may ask."""
        return self._there.result(self._limit_s)


@contextmanager
def session(
    network: QuantumNetwork,
    service: str,
    ends: tuple[str, str],
    port: int = SERVICE_PORT,
    **options: Any,
) -> Iterator[Asked]:
    """Have one host ask another for a service; end it behind the block."""
    opener, acceptor = ends
    limit_s, sockets = network.runtime.time.wall_s(STALL_TIMEOUT_S), network.runtime.socket
    with (
        ThreadPoolExecutor(1) as beside,
        ServiceSocket(sockets(acceptor)) as listener,
        ServiceSocket(sockets(opener)) as asking,
    ):
        for each in (listener, asking):
            each.settimeout(limit_s)
        listener.listen(port, service)
        results = asking.request(service, (acceptor, port), **options)
        there = beside.submit(_accepted, listener)
        yield Asked(asking, results, there, limit_s)
        asking.shutdown()
        there.result(limit_s).close()


def _accepted(listener: ServiceSocket) -> ServiceSocket:
    asked, _peer = listener.accept()
    try:
        list(asked.results())
    except BaseException:
        asked.close()
        raise
    return asked
