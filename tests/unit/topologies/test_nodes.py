"""Nodes whose shell has ended, where Mininet alone would wait for ever."""

from typing import Any

import pytest
from mininet.node import Node

from topologies.nodes import OpticalSwitch, ShellWatcher
from wire.config import BadConfig, PathOptics


class Watched(ShellWatcher, Node):
    """A node of no special kind."""


def test_a_command_in_whose_middle_the_shell_ends_returns() -> None:
    node = Watched("watched", inNamespace=False)
    assert node.cmd("echo here").strip() == "here"
    assert not node.shell_ended
    node.cmd("kill -KILL $$")
    assert node.shell_ended
    assert node.cmd("echo too late") == ""
    node.terminate()


@pytest.mark.parametrize(
    ("optics", "message"),
    [
        ({"rotation": 7}, "q1: rotation 7 is not 0 to 3"),
        ({"crosstalk_db": -40.0}, "q1: crosstalk_db -40.0 is not 0 to 100"),
        ({"paths": [PathOptics(1, 2, -1.0)]}, "path 1 -> 2: insertion_loss_db -1.0"),
        ({"max_temperature_c": float("nan")}, "max_temperature_c nan"),
        ({"grid_mhz": 0}, "grid_mhz 0"),
        ({"controller_port": 0}, "q1: controller_port 0 is not 1 to 65535"),
        ({"controller_port": 65536}, "q1: controller_port 65536 is not 1 to 65535"),
    ],
)
def test_optics_that_cannot_be_are_refused_before_a_switch_is_made(
    optics: dict[str, Any], message: str
) -> None:
    with pytest.raises(BadConfig, match=message):
        OpticalSwitch("q1", **optics)
