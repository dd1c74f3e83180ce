"""The agent measures what it asks of the hardware."""

from pathlib import Path

import pytest
from test_simulated_switch import play, simulation

from qswitch_agent.hardware.optics import CrossConnect, HardwareRefusal
from qswitch_agent.metrics import MeasuredHardware


def test_cross_connects_and_refusals_are_counted_and_timed(tmp_path: Path) -> None:
    async def scene() -> None:
        async with simulation(tmp_path) as b:
            hardware = MeasuredHardware(b.switch)
            value = hardware.registry.get_sample_value
            await hardware.set_cross_connects([CrossConnect(1, 2), CrossConnect(3, 4)])
            assert b.connections == {1: 2, 3: 4}
            assert value("qmn_light_paths") == 2
            with pytest.raises(HardwareRefusal):
                await hardware.set_cross_connects([CrossConnect(1, 99)])
            assert value("qmn_light_paths") == 2
            await hardware.set_cross_connects([CrossConnect(1, 2)])
            assert (await hardware.read()).ports
            labels = {"rpc": "cross_connects"}
            assert value("qmn_hardware_refusals_total", labels) == 1
            assert value("qmn_rpc_seconds_count", labels) == 3
            assert value("qmn_rpc_seconds_count", {"rpc": "read"}) == 1
            assert value("qmn_light_paths") == 1

    play(scene())
