"""Optics of a quantum switch that can be, and those that cannot."""

from dataclasses import replace
from typing import Any

import pytest

from wire.parameters.physics import BadParameter
from wire.parameters.switch import PathOptics, QuantumSwitch


def test_the_optics_of_a_good_switch_are_accepted() -> None:
    QuantumSwitch("q1").check()
    paths = [PathOptics(1, 2, 0.5, 3), PathOptics(2, 1)]
    QuantumSwitch("q1", crosstalk_db=40, paths=paths).check()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"switching_time_s": 61.0}, "switching_time_s 61.0: choose 0 to 60"),
        ({"insertion_loss_db": -0.1}, "insertion_loss_db -0.1: choose 0 to 100"),
        ({"insertion_loss_db": float("nan")}, "insertion_loss_db nan"),
        ({"rotation": 4}, r"rotation 4: choose 0 to 3 \(I, X, Z, XZ\)"),
        ({"rotation": 1.0}, "rotation 1.0"),
        ({"crosstalk_db": -1.0}, "crosstalk_db -1.0"),
        ({"temperature_c": "hot"}, "temperature_c 'hot'"),
        ({"max_temperature_c": float("inf")}, "max_temperature_c inf"),
        ({"hot_loss_db": None}, "hot_loss_db None"),
        ({"grid_mhz": 0}, "grid_mhz 0"),
        ({"min_power_dbm": 1.0}, "min_power_dbm 1.0"),
        ({"min_frequency_mhz": 196_200_000}, "is above max_frequency_mhz 196100000"),
        ({"paths": [PathOptics(1, 2), PathOptics(1, 2)]}, "path 1 -> 2 is named twice"),
        ({"paths": [PathOptics(1, 2, -3.0)]}, "path 1 -> 2: insertion_loss_db -3.0"),
        ({"paths": [PathOptics(1, 2, 0.0, 7)]}, "path 1 -> 2: rotation 7"),
    ],
)
def test_optics_that_cannot_be_are_refused_with_the_value(
    changes: dict[str, Any], message: str
) -> None:
    with pytest.raises(BadParameter, match=f"q1.*{message}"):
        replace(QuantumSwitch("q1"), **changes).check()
