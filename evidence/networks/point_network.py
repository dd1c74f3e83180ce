"""The network of a point of an experiment: which one, its fibres, its software, sessions in it."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from mininet.topo import Topo

from evidence.curves.experiment import Experiment, SweepError
from evidence.curves.parameters import Parameter, Values
from hosts.client import BlockingSession, blocking_session
from hosts.stack_socket import QuantumSocketError
from qmn.network.custom_topology import BadTopology
from qmn.network.time_scale import STEPPED
from qmn.options import BadInput
from qmn.requests.service_verbs import SERVICE_PORT
from qmn.results.run_folder import begin_folder
from qmn.scripting import QuantumNetwork, start
from qmn.timeouts import STALL_TIMEOUT_S
from topologies.system.processes.programs import NetworkError
from wire.parameters.delays import MOST_NS

CONTROLLER_DELAY = Parameter("controller_delay_s", 0.0, 0.0, MOST_NS / 1e9, "s")


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
        with start(topology, folder, time=STEPPED, **options) as network:
            yield network
    except (NetworkError, QuantumSocketError, TimeoutError, BadInput, BadTopology) as error:
        raise SweepError(f"{experiment.place(values)} failed: {error}") from error


@contextmanager
def session(
    network: QuantumNetwork,
    service: str,
    ends: tuple[str, str],
    port: int = SERVICE_PORT,
    **options: Any,
) -> Iterator[BlockingSession]:
    """Have one host ask another for a service; end it behind the block."""
    options["limit_s"] = STALL_TIMEOUT_S
    with blocking_session(
        network.runtime.socket, service, ends, port, network.runtime.time, **options
    ) as running:
        yield running
        running.end()


def delay(seconds: float) -> str:
    return f"{round(seconds * 1e9)}ns"
