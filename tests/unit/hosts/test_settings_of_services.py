"""Sessions of every service feel the settings that qmn run takes, and none that it refuses.

Seeds are alike, so that outcomes are: of summaries those fields count that are the same when a
session is repeated. Which single settings a part has an effect by, test_every_setting.py shows.
"""

import asyncio
from dataclasses import replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pytest
from fault_scene import SERVICES, running, session

from hosts import network_loop
from qmn.network.felt_settings import felt_by
from topologies.description.description import Description, LaidFiber
from wire.parameters.fiber import FiberOptics
from wire.parameters.physics import Device
from wire.parameters.switch import QuantumSwitch

VALUES: dict[str, Any] = {
    "source.fidelity": 0.8,
    "source.preparation_error": 0.1,
    "source.jitter_ps": 1e3,
    "source.encoding": "time-bin",
    "memory.efficiency": 0.7,
    "detectors.efficiency": 0.7,
    "detectors.readout_error": 0.1,
    "detectors.encoding": "time-bin",
    "analyser.visibility": 0.3,
    "gates.one_qubit_depolarizing": 0.3,
    "gates.two_qubit_depolarizing": 0.3,
    "gates.readout_error": 0.2,
    "gates.initialization_error": 0.4,
    "emitter.scheme": "two-click",
    "emitter.efficiency": 0.1,
    "sensor.phase_rad": 1.0,
    "compensator.retarders": 3,
    "compensator.insertion_loss_db": 10.0,
}
Fields = dict[str, Any]
RANDOM = frozenset({"ones_fraction"})  # of bits that are disclosed: which they are, no seed says
# In bases that differ, which end measures first decides the outcomes, hence the CHSH value and
# whether a further round is needed. Only E91 keeps such outcomes.
BY_ORDER = frozenset(
    {
        *("chsh", "chsh_error", "chsh_pairs", "photons", "raw_bits", "sifted_bits", "qber_high"),
        *("disclosed_bits", "leaked_bits", "key_bits", "key_fraction", "net_key_bits"),
    }
)
HOSTS = ("alice", "bob", "charlie")
# Services in whose memories light waits only if it comes before its order, as chance has it.
DIRECT = ("sdc", "bb84", "bbm92", "e91", "mdi", "seal")


def felt(service: str) -> dict[str, frozenset[str]]:
    """Return what qmn run takes for each host."""
    fibers = tuple(LaidFiber(name, "q1", FiberOptics()) for name in 2 * HOSTS)
    devices, switches = dict.fromkeys(HOSTS, Device()), {"q1": QuantumSwitch("q1")}
    parts = Description(devices, switches, fibers, ("charlie",))
    return felt_by(service, ("alice", "bob"), parts).devices


def device(settings: dict[str, Any]) -> Device:
    result = Device()
    for setting, value in settings.items():
        part, _dot, name = setting.partition(".")
        result = replace(result, **{part: replace(getattr(result, part), **{name: value})})
    return result


def summaries(service: str, devices: dict[str, Device]) -> Fields:
    """Return the results of both ends of a session."""

    async def run(folder: Path) -> Any:
        async with running(folder, service, devices=devices):
            return await asyncio.to_thread(session, folder, service)

    with TemporaryDirectory() as folder:
        report = network_loop.run(run(Path(folder)))
    return {
        f"{end} {name}": value
        for end, each in zip(("alice", "bob"), report, strict=True)
        for name, value in {"error": each.text, **each.summary}.items()
        if name not in (RANDOM | BY_ORDER if service == "e91" else RANDOM)
    }


@cache
def usual(service: str) -> Fields:
    """Return the fields that are the same in two sessions of ideal devices."""
    once, again = (summaries(service, {}) for _ in range(2))
    return {name: value for name, value in once.items() if again[name] == value}


@pytest.mark.by_day(every=2)
@pytest.mark.parametrize("service", SERVICES)
def test_settings_that_are_refused_change_nothing(service: str) -> None:
    devices = {
        host: device({s: v for s, v in VALUES.items() if s not in felt(service).get(host, ())})
        for host in HOSTS
    }
    found = summaries(service, devices)
    assert {name: found[name] for name in usual(service)} == usual(service)


@pytest.mark.by_day(every=6)
@pytest.mark.parametrize(
    ("service", "host", "part"),
    [
        (service, host, part)
        for service in SERVICES
        for host, settings in felt(service).items()
        for part in sorted({setting.partition(".")[0] for setting in settings & VALUES.keys()})
        if not (service in DIRECT and part == "memory")
    ],
)
def test_every_part_whose_settings_are_taken_changes_something(
    service: str, host: str, part: str
) -> None:
    settings = {
        setting: VALUES[setting]
        for setting in felt(service)[host] & VALUES.keys()
        if setting.startswith(part) and "encoding" not in setting
    }
    found = summaries(service, {host: device(settings)})
    assert {name: found.get(name) for name in usual(service)} != usual(service)
