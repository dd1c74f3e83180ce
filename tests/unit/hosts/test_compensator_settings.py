"""The controller sets how often a host's compensator looks: whole stacks over loopback."""

import asyncio
from io import StringIO
from pathlib import Path

import pytest
from stacks_scene import network, requested

from hosts import network_loop
from hosts.middleware.session.errors import SessionError
from hosts.stack import Stack
from wire.device import DeviceSettings
from wire.parameters.physics import Compensator, Device

COMPENSATING = {"bob": Device(compensator=Compensator(3, every_s=50.0))}


def test_the_controller_sets_how_often_a_compensator_looks(tmp_path: Path) -> None:
    events, stacks = StringIO(), dict[str, Stack]()

    async def run() -> None:
        async with network(tmp_path, devices=COMPENSATING, events=events, stacks=stacks):
            for every_s in (7, 7, None):  # the same setting again is no new look
                stacks["bob"].device.set(DeviceSettings(compensate_s=every_s))
            await asyncio.to_thread(requested, tmp_path, "sdc")

    network_loop.run(run())
    looks = [line for line in events.getvalue().splitlines() if "compensator: looks" in line]
    assert ["every 7 s" in looks[0], "every 50 s" in looks[1]] == [True, True]
    assert len(looks) == 2


def test_a_host_without_a_compensator_refuses_the_setting(tmp_path: Path) -> None:
    stacks = dict[str, Stack]()

    async def run() -> None:
        async with network(tmp_path, devices=COMPENSATING, stacks=stacks):
            with pytest.raises(SessionError, match="no compensator here"):
                stacks["alice"].device.set(DeviceSettings(compensate_s=7))
            assert stacks["alice"].device.settings == DeviceSettings()

    network_loop.run(run())
