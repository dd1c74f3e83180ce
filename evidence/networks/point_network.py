"""The network of a point of an experiment: which one, its fibres, its software, sessions in it."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from mininet.topo import Topo

from evidence.curves.experiment import Experiment, SweepError, number
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

TOPOLOGY = Parameter("topology", "sdc", text="a name of `qmn run`, or FILE.py:CLASS")
MAP = Parameter("map", "", text="a known map or a file")
SENDER = Parameter("from", "alice", text="the host that asks")
RECEIVER = Parameter("to", "bob", text="the host that is asked")
PLACES = (TOPOLOGY, MAP, SENDER, RECEIVER)
CONTROLLER_DELAY, HOST_DELAY, AGENT_DELAY = SOFTWARE = tuple(
    Parameter(f"{name}_delay_s", 0.0, 0.0, MOST_NS / 1e9, "s")
    for name in ("controller", "host", "switch_agent")
)


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
    where = network.runtime.socket, service, ends, port, network.runtime.time
    with blocking_session(*where, **options) as asked:
        yield asked
        asked.end()


def delays(values: Values) -> dict[str, str]:
    """Return what software takes, as options of a network."""
    return {each.name.removesuffix("_s"): delay(number(values, each.name)) for each in SOFTWARE}


def delay(seconds: float) -> str:
    return f"{round(seconds * 1e9)}ns"


def is_default(values: Values) -> bool:
    """Return whether it is the network that theory covers: one switch, alice and bob."""
    return all(values[place.name] == place.default for place in PLACES)


def topology_options(values: Values) -> dict[str, Any]:
    name, known_map = values[TOPOLOGY.name], values[MAP.name] or None
    only_map = known_map is not None and name == TOPOLOGY.default
    return {"topology": "" if only_map else name, "map": known_map}


def fiber_settings(values: Values, parameters: Sequence[Parameter]) -> tuple[str, ...]:
    """Return the settings of every fibre; of other networks only those that are not defaults.

    Their fibres may have optics of their own, and their `build` need not take any.
    """
    omitted = left_to_network(parameters, values)
    return tuple(
        f"{parameter.name}={values[parameter.name]}"
        for parameter in parameters
        if parameter.name not in omitted
    )


def left_to_network(parameters: Sequence[Parameter], values: Values) -> set[str]:
    """Return the parameters of fibres for which other networks have values of their own."""
    if is_default(values):
        return set()
    return {each.name for each in parameters if values[each.name] == each.default}
