"""The instrument that a configuration of a quantum switch asks for."""

import asyncio
from dataclasses import replace
from typing import Any

import pytest

from applications.instruments.scpi import ScpiSwitch
from qswitch_agent.__main__ import hardware
from wire.config import AgentConfig, BadConfig

CONFIG = AgentConfig(
    switch="q1",
    listen="127.0.0.1:0",
    controllers=[],
    management="/nowhere",
    dispatcher="/nowhere",
    token="secret",
    fiber_ports=[2, 3],
)
MATRIX = {"2": [1, 17], "3": [2, 18]}


def kind(config: AgentConfig) -> type:
    """Return the driver's class."""

    async def build() -> type:
        driver = hardware(config)
        await driver.close()
        return type(driver)

    return asyncio.run(build())


@pytest.mark.parametrize(
    "url", ["scpi://192.0.2.7", "scpi://matrix.example:5025", "scpi://[2001:db8::7]:1"]
)
def test_an_instrument_is_named_by_its_address(url: str) -> None:
    assert kind(replace(CONFIG, hardware=url, hardware_ports=MATRIX)) is ScpiSwitch


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"hardware": "gpib://7"}, "hardware 'gpib://7' is not known"),
        ({"analysers": 2}, "2 analysers with hardware scpi://.*: an instrument of mirrors has"),
        ({"memories": 1}, "1 memories with hardware scpi://.*: an instrument of mirrors has"),
        ({"hardware": "192.0.2.7:5025"}, "not known"),
        ({"hardware": "scpi://"}, "not known"),
        ({"hardware": "scpi://a:0"}, "not known"),
        ({"hardware": "scpi://a/path"}, "not known"),
        ({"hardware": "scpi://a:x"}, "hardware 'scpi://a:x'"),
        ({"hardware": "scpi://a:70000"}, "out of range"),
        ({"hardware": ""}, "hardware_ports are given without hardware"),
        ({"hardware_ports": {}}, "hardware_ports of fibre port 2 are None"),
        ({"hardware_ports": {"2": [1, 17]}}, "hardware_ports of fibre port 3 are None"),
        ({"hardware_ports": {**MATRIX, "3": [2]}}, r"fibre port 3 are \[2\]"),
        ({"hardware_ports": {**MATRIX, "3": [0, 18]}}, "fibre port 3"),
        ({"hardware_ports": {**MATRIX, "3": ["2", 18]}}, "fibre port 3"),
        ({"hardware_ports": {**MATRIX, "3": [2, 17]}}, "port 17 of the instrument twice"),
        ({"hardware_ports": {**MATRIX, "3": [2, 2]}}, "port 2 of the instrument twice"),
        ({"hardware_ports": {**MATRIX, "9": [3, 19]}}, "name port '9', where no fibre ends"),
    ],
)
def test_hardware_that_cannot_be_is_refused(changes: dict[str, Any], message: str) -> None:
    named = replace(CONFIG, hardware="scpi://192.0.2.7:5025", hardware_ports=MATRIX)
    with pytest.raises(BadConfig, match=message):
        hardware(replace(named, **changes))
