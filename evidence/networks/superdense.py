"""Superdense coding in whole networks, each started and ended for a point, as `qmn run` does."""

import random
from functools import partial
from pathlib import Path
from tempfile import NamedTemporaryFile
from typing import Any

from rich.console import Console

from evidence.curves import theory
from evidence.curves.catalogue import EXPERIMENTS
from evidence.curves.estimates import Estimate, proportion
from evidence.curves.experiment import Experiment, Measure, Outcome, SweepError, number
from evidence.curves.link import FIBER, PRESET, implied
from evidence.curves.parameters import Parameter, Point, Values
from evidence.curves.superdense import LOSSES, loss_db
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
from qmn.jobs import runner, superdense
from qmn.jobs.transfer import TransferError
from qmn.network.custom_topology import BadTopology
from qmn.network.time_scale import STEPPED
from qmn.options import BadInput
from qmn.requests.superdense import SuperdenseRequest, superdense_request
from qmn.results.run_result import RunResult
from topologies.networks.network import Signals
from topologies.system.processes.programs import NetworkError
from wire.parameters.network import MOST_KM
from wire.results.figures import SentFigures

# charlie's photon for alice passes two fibres to her and two more to bob, the other one two.
FIBERS_PASSED = 6
RATE, FEC, INTERLEAVE = map(EXPERIMENTS["sdc"].parameter, ("rate_hz", "fec", "interleave"))
MESSAGE_BYTES = Parameter("message_bytes", 65_536, 1, 1 << 30)
FRAME_BYTES = Parameter("frame_bytes", 32, 1, 65_536)
CONTROL_KM = Parameter("control_km", 0.0, 0.0, MOST_KM, "km")
OPTIONS = (RATE, FRAME_BYTES, FEC, PRESET, CONTROL_KM)  # by these names of its request


def measure(values: Values, seed: int, runs: Path, signals: Signals) -> Outcome:
    with NamedTemporaryFile(prefix="qmn-sweep-") as message:
        data = random.Random(seed).randbytes(int(values[MESSAGE_BYTES.name]))  # noqa: S311
        message.write(data)
        message.flush()
        asked = request(values, seed, Path(message.name), runs)
        try:
            job, context = superdense.begun(asked, signals, Console(quiet=True))
            figures = runner.run(job, context)
        except (NetworkError, TransferError, BadInput, BadTopology) as error:
            raise SweepError(f"{SUPERDENSE.place(values)} failed: {error}") from error
    return outcome(figures)


def request(values: Values, seed: int, message: Path, runs: Path) -> SuperdenseRequest:
    named: dict[str, Any] = {each.name: values[each.name] for each in OPTIONS}
    return superdense_request(
        file=message,
        sender=values[SENDER.name],
        receiver=str(values[RECEIVER.name]),
        interleave=values[INTERLEAVE.name] == "on",
        seed=seed,
        fiber=fiber_settings(values, FIBER),
        runs=runs,
        captures="none",
        without="report",
        time=STEPPED,
        **topology_options(values),
        **delays(values),
        **named,
    )


def outcome(result: RunResult) -> Outcome:
    figures, setup_ms = result.asking, result.path_setup_ms.p50
    assert isinstance(figures, SentFigures)
    assert setup_ms is not None  # it has gone well
    came = figures.bell_pairs - figures.lost_pairs
    return {
        "dibit_error": proportion(figures.symbol_errors, came),
        "arrived": proportion(came, figures.bell_pairs),
        "path_setup_s": Estimate(setup_ms / 1e3, 0.0),
    }


def dibit_error(values: Values) -> float | None:
    """Return the theory of dibit_error: every fibre that a pair passes depolarises."""
    if not is_known(values):
        return None
    return theory.dibit_error(theory.together(*[number(values, "depolarizing")] * FIBERS_PASSED))


def arrived(values: Values) -> float | None:
    return theory.transmission(FIBERS_PASSED * loss_db(Point(values))) if is_known(values) else None


def fiber_implied(given: Values) -> Values:
    values = implied(given)
    return {each.name: values[each.name] for each in FIBER}


def is_known(values: Values) -> bool:
    """Return whether there is no noise but loss and depolarising."""
    numbers = (each for each in FIBER if each.name not in ("kind", "depolarizing", *LOSSES))
    plain = all(values[each.name] == each.default for each in numbers)
    return plain and values[PRESET.name] == PRESET.default and is_default(values)


SUPERDENSE = Experiment(
    "sdc",
    "superdense coding in the emulated network",
    (
        *FIBER,
        PRESET,
        RATE,
        FRAME_BYTES,
        FEC,
        CONTROL_KM,
        *SOFTWARE,
        INTERLEAVE,
        MESSAGE_BYTES,
        *PLACES,
    ),
    (
        Measure("dibit_error", "dibit error", dibit_error),
        Measure("arrived", "part of the pairs that arrives", arrived),
        Measure("path_setup_s", "from metadata at the controller to the light path (s)"),
    ),
    implied=fiber_implied,
    unsaid=partial(left_to_network, FIBER),
)
