"""Every setting of devices, fibres and switches comes to the programs that need it, and no other.

The settings are those that are declared: a new one is tried without a word here.
"""

import json
from collections.abc import Callable, Mapping
from dataclasses import Field, asdict, fields, replace
from math import inf
from pathlib import Path
from typing import Any

import pytest
from described import changes, configurations

from topologies.catalogue.node_kinds import NODE_KINDS, node_device
from topologies.catalogue.presets import PRESETS
from wire.parameters.fiber import FiberOptics
from wire.parameters.physics import Device
from wire.parameters.switch import COMPOUND, OPTICS, QuantumSwitch

MODEL = f"{Path(__file__).with_name('own_noise.py')}:Model"
# Values of fields that declare neither a range nor choices, and of those that others bound.
VALUES = {
    "bell_diagonal": [0.1, 0.2, 0.3, 0.4],
    "decoys": [0.1, 0.0],
    "noise": MODEL,
    "noise_parameters": {"flip": 0.25},
    "max_rate_hz": 1000.0,
    "min_frequency_mhz": 192_000_000,
    "channels": 2,
    "retarders": 3,
}
POISSON = {"source.statistics": "poisson"}
BESIDE: dict[str, Mapping[str, Any]] = {  # what a value needs, or what makes somebody feel it
    "source.mean_pairs": POISSON,
    "source.decoys": POISSON,
    "source.heralding_efficiency": POISSON,
    "memory.t1_s": {"memory.t2_s": 1e-3},
}
# The part of its own device that the stack of a host gets.
STACK: dict[str, Callable[[Device], Any]] = {
    "analyser": lambda device: device.analyser.kind,
    "features": lambda device: device.features.value,
    "memory_qubits": lambda device: device.memory.capacity,
    "multi_photon": lambda device: device.source.multi_photon,
    "intensities": lambda device: [*device.source.intensities],
    "t1_s": lambda device: device.memory.t1_s,
    "t2_s": lambda device: device.memory.t2_s,
    "depolarizing_s": lambda device: device.memory.depolarizing_s,
    "cutoff_s": lambda device: device.memory.cutoff_s,
    "compensates": lambda device: device.compensator.retarders > 0,
}
OF_ALL: dict[str, Callable[[Device], Any]] = {  # and every stack, of alice's
    "pair_rate_hz": lambda device: min(50_000_000, int(device.source.max_rate_hz)),
}
HOSTS = "alice", "bob", "charlie"
FIBERS = ("alice", "bob", "bob", "charlie", "charlie")  # of `sdc`, the hosts at their ends
DEVICE = {
    f"{part.name}.{each.name}": each
    for part in fields(Device)
    for each in fields(type(part.default))  # type: ignore[arg-type]
}
FIBER = {each.name: each for each in fields(FiberOptics)}
SWITCH = {each.name: each for each in fields(QuantumSwitch) if each.name in OPTICS - COMPOUND}


def another(setting: "Field[Any]") -> Any:
    """Return a value of a setting that is not its default."""
    if setting.name in VALUES:
        return VALUES[setting.name]
    if "choices" in setting.metadata:
        return setting.metadata["choices"][-1]
    least, most, *_ = setting.metadata["range"]
    default: Any = most if setting.default is None else setting.default
    end = most if abs(default - least) < abs(most - default) else least
    middle = (default + end) / 2 if abs(default) + abs(end) < inf else max(least, 1e-3)
    return int(middle) if isinstance(least, int) else middle


def text(value: Any) -> str:
    """Return a value as it is written on the command line."""
    return json.dumps(value) if isinstance(value, list | dict) else str(value)


def device(settings: Mapping[str, Any]) -> Device:
    """Return the device that has these settings, by PART.NAME."""
    found = Device()
    for where, value in settings.items():
        part, _dot, name = where.partition(".")
        value = tuple(value) if isinstance(value, list) else value
        found = replace(found, **{part: replace(getattr(found, part), **{name: value})})
    return found


def words(settings: Mapping[str, Any]) -> list[str]:
    """Return settings of alice's device as they are written on the command line."""
    lines = [f"alice.{name}={text(value)}" for name, value in settings.items()]
    return [word for each in lines for word in ("--device", each)]


@pytest.mark.parametrize("setting", DEVICE)
def test_a_setting_of_a_device_comes_to_the_dispatcher_and_its_consequences_to_stacks(
    setting: str,
) -> None:
    beside = BESIDE.get(setting, {})
    given = {setting: another(DEVICE[setting])}
    before, after = device(beside), device({**beside, **given})
    expected = {f"dispatcher.devices.alice.{setting}": given[setting]}
    for hosts, parts in (("alice",), STACK), (HOSTS, OF_ALL):
        expected |= {
            f"{host}.{name}": value(after)
            for host in hosts
            for name, value in parts.items()
            if value(after) != value(before)
        }
    assert changes(words(given), words(beside)) == expected


@pytest.mark.parametrize("setting", sorted(FIBER.keys() - {"length_km", "channels"}))
def test_a_setting_of_fibres_comes_to_the_dispatcher_for_those_that_are_named(
    setting: str,
) -> None:
    value = another(FIBER[setting])
    for place in ("", "alice-q1.", "q1-bob."):
        expected = {
            f"dispatcher.fibers.{number}.{setting}": value
            for number, host in enumerate(FIBERS)
            if not place or host in place
        }
        assert changes(["--fiber", f"{place}{setting}={text(value)}"]) == expected


def test_the_copper_beside_a_fibre_is_as_long() -> None:
    changed = changes(["--fiber", "alice-q1.length_km=204"])  # a millisecond of light
    assert changed.pop("dispatcher.fibers.0.length_km") == 204.0
    ways = [f"dispatcher.news_s.{way}" for way in ("alice.s1", "s1.alice")]
    delays = [changed.pop(name) for name in (*ways, "copper.cables.0.delay_s")]
    assert delays == pytest.approx([1e-3] * 3, rel=1e-3)  # and 10 m from q1 to s1
    assert all(name.startswith("copper.cables") for name in changed)


def test_a_fibre_of_two_channels_has_two_pairs_of_ports() -> None:
    changed = configurations("--fiber", "alice-q1.channels=2")
    first, second = (fiber for fiber in changed["dispatcher"]["fibers"] if fiber["channels"] == 2)
    assert [first["channel"], second["channel"]] == [1, 2]
    assert changed["alice"]["qnics"] == [first["a"]["port"], second["a"]["port"]]
    assert changed["alice"]["channels_mhz"] == {
        first["a"]["port"]: 193_400_000,
        second["a"]["port"]: 193_500_000,
    }
    ports = {int(first["b"]["port"]), int(second["b"]["port"])}
    assert ports <= set(changed["q1"]["fiber_ports"])


@pytest.mark.parametrize("setting", SWITCH)
def test_a_setting_of_a_switch_comes_to_the_dispatcher(setting: str) -> None:
    value = another(SWITCH[setting])
    agent = {f"q1.{setting}": value} if setting in ("analysers", "memories", "sources") else {}
    for place in ("", "q1."):
        changed = changes(["--switch", f"{place}{setting}={text(value)}"])
        assert changed == {f"dispatcher.switches.0.{setting}": value, **agent}, place


def test_a_setting_of_a_part_of_a_switch_comes_to_the_dispatcher() -> None:
    changed = changes(["--switch", "q1.memories=2", "--switch", "memory.t2_s=0.5"])
    assert changed.pop("q1.memories") == changed.pop("dispatcher.switches.0.memories") == 2
    assert changed == {"q1.parts.memory.t2_s": 0.5, "dispatcher.switches.0.memory.t2_s": 0.5}


@pytest.mark.parametrize("kind", NODE_KINDS)
def test_a_kind_of_node_comes_to_the_dispatcher_as_it_is_catalogued(kind: str) -> None:
    wanted = json.loads(json.dumps(asdict(node_device(kind, Device()))))
    of_all = [(None, kind)] * (kind != "station")  # it is part of a network
    for host, node in (*of_all, ("bob", f"bob={kind}")):
        changed = configurations("--node", node)["dispatcher"]["devices"]
        for name in HOSTS:
            if host in (None, name) and name != "charlie":
                assert changed[name] == wanted
            elif host:
                assert changed[name] == json.loads(json.dumps(asdict(Device())))


@pytest.mark.parametrize("preset", PRESETS)
def test_a_preset_comes_to_the_dispatcher_as_it_is_catalogued(preset: str) -> None:
    changed = configurations("--preset", preset)["dispatcher"]
    wanted = PRESETS[preset]
    for fiber in changed["fibers"]:
        assert {name: fiber[name] for name in wanted.fiber} == wanted.fiber
    assert changed["devices"]["alice"] == json.loads(json.dumps(asdict(wanted.device)))
