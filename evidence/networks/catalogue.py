"""The experiments in whole networks beside sweeps of jobs: demos, each on a grid that shows it."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

from evidence.curves.experiment import Experiment, Outcome
from evidence.curves.parameters import Values
from evidence.networks import (
    congestion,
    control,
    flapping,
    head_of_line,
)
from topologies.networks.network import Signals

Measurer = Callable[[Values, int, Path, Signals], Outcome]


@dataclass(frozen=True)
class Demo:
    """A figure: its experiment, the measurement of a point, and its grid."""

    what: str
    experiment: Experiment
    measure: Measurer
    axes: Mapping[str, str]


DEMOS: Mapping[str, Demo] = MappingProxyType(
    {
        "congestion": Demo(
            "congestion on copper costs fidelity of teleportation",
            congestion.CONGESTION,
            congestion.measure,
            {"share": "0,0.2,0.4,0.6,0.7,0.8"},
        ),
        "overload": Demo(
            "a busy controller turns into decoherence of memories",
            control.CONTROL,
            control.measure,
            {"requesters": "0,1,2,4,8", "controller_delay_s": "0.001"},
        ),
        "far-controller": Demo(
            "so does a long way to it",
            control.CONTROL,
            control.measure,
            {"control_km": "0,5000,10000,20000"},
        ),
        "flapping": Demo(
            "a fibre that flaps costs light, and no more if it flaps faster",
            flapping.FLAPPING,
            flapping.measure,
            {"period_s": "0.25,0.5,1,2,4,8", "controller_delay_s": "0.02"},
        ),
        "head-of-line": Demo(
            "a few long sessions keep all others waiting",
            head_of_line.HEAD_OF_LINE,
            head_of_line.measure,
            {"long_s": "0.2,0.5,1,1.5,2"},
        ),
    }
)
EMULATED: Mapping[str, Experiment] = MappingProxyType(
    {demo.experiment.name: demo.experiment for demo in DEMOS.values()}
)
MEASURED_BY: Mapping[str, Measurer] = MappingProxyType(
    {demo.experiment.name: demo.measure for demo in DEMOS.values()}
)
