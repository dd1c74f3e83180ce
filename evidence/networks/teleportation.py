"""Teleportation in whole networks whose copper or software is slow: what waiting costs.

The receiver's halves wait in its memory until the two bits of each are there, as packets that queue
for slow copper. How long that was is measured, and theory is asked about that time.
"""

import math
from functools import partial
from pathlib import Path

from rich.console import Console

from evidence.curves import theory
from evidence.curves.estimates import NOTHING, Estimate, proportion
from evidence.curves.experiment import Experiment, Measure, Outcome, SweepError, number
from evidence.curves.link import FIBER
from evidence.curves.parameters import Parameter, Values, of_dataclass
from evidence.networks.point_network import (
    PLACES,
    RECEIVER,
    SENDER,
    SOFTWARE,
    delays,
    fiber_settings,
    is_default,
    left_to_network,
    topology_options,
)
from qmn.jobs import counted_service, runner
from qmn.jobs.transfer import TransferError
from qmn.network.custom_topology import BadTopology
from qmn.network.time_scale import STEPPED
from qmn.options import BadInput
from qmn.requests.service import ServiceRequest, service_request
from topologies.networks.network import Signals
from topologies.system.processes.programs import NetworkError
from wire.parameters.network import LEAST_MBPS, MOST_MBPS
from wire.parameters.physics import Memory
from wire.results.figures import TeleportFigures

FIBERS_PASSED = 4  # two by either half of a pair
RATE = Parameter("copper_mbps", MOST_MBPS, LEAST_MBPS, MOST_MBPS, "Mbit/s")
(DEPOLARIZING,) = (each for each in FIBER if each.name == "depolarizing")
MEMORY = {each.name: each for each in of_dataclass("memory_", Memory())}
T1, T2 = MEMORY["memory_t1_s"], MEMORY["memory_t2_s"]
STATE = Parameter("state", "random", choices=("random", "haar"))
STATES = Parameter("states", 16_384, 100, 262_144)
WAITED = Parameter("measured_wait_s", 0.0)


def measure(values: Values, seed: int, runs: Path, signals: Signals) -> Outcome:
    """Teleport states, all in one block: they wait equally long."""
    try:
        job, context = counted_service.begun(
            request(values, seed, runs), signals, Console(quiet=True)
        )
        figures = runner.run(job, context).asking
    except (NetworkError, TransferError, BadInput, BadTopology) as error:
        raise SweepError(f"{TELEPORT.place(values)} failed: {error}") from error
    assert isinstance(figures, TeleportFigures)  # it has gone well
    return outcome(figures)


def request(values: Values, seed: int, runs: Path) -> ServiceRequest:
    states, state = int(values[STATES.name]), str(values[STATE.name])
    receiver = str(values[RECEIVER.name])
    times = {time.name.removeprefix("memory_"): values[time.name] for time in (T1, T2)}
    return service_request(
        "teleport",
        sender=values[SENDER.name],
        receiver=receiver,
        count=states,
        state=state,
        block_pairs=states,
        seed=seed,
        backend="chp" if state == "random" else "dense",
        fiber=fiber_settings(values, [DEPOLARIZING]),
        time=STEPPED,
        device=tuple(f"{receiver}.memory.{name}={time}" for name, time in times.items()),
        runs=runs,
        copper_mbps=values[RATE.name],
        captures="none",
        without="report",
        **topology_options(values),
        **delays(values),
    )


def outcome(figures: TeleportFigures) -> Outcome:
    if figures.fidelity is None or figures.waited_ms is None:
        return {WAITED.name: NOTHING, "teleported": NOTHING}
    return {
        WAITED.name: Estimate(figures.waited_ms / 1000, 0.0),
        "teleported": proportion(round(figures.fidelity * figures.arrived), figures.arrived),
    }


def teleported(values: Values) -> float | None:
    waited_s = number(values, WAITED.name)
    if math.isnan(waited_s) or not is_default(values):
        return None
    p = theory.together(*[number(values, DEPOLARIZING.name)] * FIBERS_PASSED)
    return theory.waited_fidelity(waited_s, number(values, T1.name), number(values, T2.name), p)


TELEPORT = Experiment(
    "teleport",
    "teleportation in the emulated network with slow copper or software",
    (RATE, T1, T2, DEPOLARIZING, STATE, STATES, *SOFTWARE, *PLACES),
    (
        Measure(WAITED.name, "measured wait in memory for the two bits (s)"),
        Measure("teleported", "average fidelity of the teleported state", teleported, over=WAITED),
    ),
    unsaid=partial(left_to_network, (DEPOLARIZING,)),
)
