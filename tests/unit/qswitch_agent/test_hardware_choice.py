"""The driver that a configuration asks for."""

import asyncio
import json
import os
import subprocess
import sys
from dataclasses import asdict, replace
from pathlib import Path

from limits import SOON_S

from qswitch_agent.__main__ import hardware
from qswitch_agent.hardware.simulated import SimulatedSwitch
from wire.config import AgentConfig

CONFIG = AgentConfig(
    switch="q1",
    listen="127.0.0.1:0",
    controllers=[],
    management="/nowhere",
    dispatcher="/nowhere",
    token="secret",
    fiber_ports=[2, 3],
)
ROOT = Path(__file__).resolve().parents[3]


def kind(config: AgentConfig) -> type:
    """Return the driver's class."""

    async def build() -> type:
        driver = hardware(config)
        await driver.close()
        return type(driver)

    return asyncio.run(build())


def test_without_more_words_the_switch_is_simulated() -> None:
    assert kind(CONFIG) is SimulatedSwitch


def test_telemetry_that_cannot_be_ends_the_agent_in_one_line(tmp_path: Path) -> None:
    (tmp_path / "broken-1.dist-info").mkdir()
    points = tmp_path / "broken-1.dist-info" / "entry_points.txt"
    points.write_text("[qmn.telemetry]\nbroken = nowhere:serving\nother = nowhere:other\n")
    file = tmp_path / "agent.json"
    file.write_text(json.dumps(asdict(replace(CONFIG, gnmi=f"{tmp_path}/gnmi"))))
    done = subprocess.run(
        [sys.executable, "-m", "qswitch_agent", "--config", str(file)],
        env={**os.environ, "PYTHONPATH": f"{ROOT}:{tmp_path}"},
        capture_output=True,
        text=True,
        timeout=SOON_S,
        check=False,
    )
    assert done.returncode == 1
    assert done.stderr.startswith(
        "fault: qswitch_agent: --gnmi: one package provides qmn.telemetry: keep"
    )
    assert done.stderr.count("\n") == 1
