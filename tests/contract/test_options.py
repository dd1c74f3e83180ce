"""Every option of a network comes to the programs that need it, and no other.

The options are those that are declared. One that is a setting of a program comes to it by its name;
the table here has the effect of each other one, and a new one without an entry fails.
"""

from collections.abc import Callable, Iterator
from dataclasses import fields
from pathlib import Path
from typing import Any

import pytest
from described import Flat, changes, configurations, flat, folder, options
from test_physical_settings import FIBER, FIBERS, HOSTS, another, text

from qmn.network.options import NetworkOptions
from topologies.system.processes.programs import ROOT
from wire.parameters.network import ControllerSettings, DispatcherSettings

OPTIONS = {each.name: each for each in fields(NetworkOptions) if "help" in each.metadata}
FILE = str(Path(__file__).resolve())
TEXTS = {
    "sabot": FILE,
    "tags": "/tmp/new-tags",
    "policy": str(ROOT / "controller_apps/policy/deny.toml"),
    "rest": "127.0.0.1:0",
    "apps": "ryu.app.ofctl_rest",
    "length_km": "2.5",
    "loss_db_per_km": "0.25",
    "depolarizing": "0.125",
}
ELSEWHERE = {  # what tries the others
    **dict.fromkeys(("fiber", "switch", "node", "device", "preset"), "test_physical_settings.py"),
    "tls_from": "tests/emulation/test_given_certificates.py, with certificates",
}
MAP = "map,abilene"


def spelled(name: str) -> list[str]:
    """Return an option as it is written, with another value than its default."""
    option = OPTIONS[name]
    flag = option.metadata.get("flag", f"--{name.replace('_', '-')}")
    return [flag, TEXTS.get(name) or text(another(option))]


def names(settings: type[Any]) -> list[str]:
    """Return the options that are settings of a program."""
    return [each.name for each in fields(settings) if each.name in OPTIONS]


OF_PROGRAMS = [("dispatcher", name) for name in names(DispatcherSettings)]
OF_PROGRAMS += [("controller", name) for name in names(ControllerSettings)]
OF_FIBERS = sorted(OPTIONS.keys() & FIBER.keys() - {"channels"})


@pytest.mark.parametrize(("program", "name"), OF_PROGRAMS)
def test_a_setting_of_a_program_comes_to_it_alone(program: str, name: str) -> None:
    words = spelled(name)
    value = getattr(options(*words), name)
    found = changes(words)
    assert found.pop(f"{program}.{name}") == (list(value) if isinstance(value, tuple) else value)
    also = {"controller.rest_fd", "controller.rest_token"} if name == "rest" else set()
    assert found.keys() == also


@pytest.mark.parametrize("name", OF_FIBERS)
def test_an_option_of_every_fibre_is_its_setting(name: str) -> None:
    words = spelled(name)
    value = getattr(options(*words), name)
    found = changes(words)
    if name == "length_km":  # copper is as long: test_physical_settings.py
        found = {path: each for path, each in found.items() if ".fibers." in path}
    assert found == {f"dispatcher.fibers.{number}.{name}": value for number in range(len(FIBERS))}


def cables(found: Flat, name: str) -> list[Any]:
    """Return a number of each cable that packets are held back on."""
    return [value for path, value in found.items() if path.endswith(f".{name}")]


def switches_of(found: Flat) -> set[str]:
    return set(numbered(found, "dispatcher.switches", "name"))


def numbered(found: Flat, where: str, name: str) -> Iterator[Any]:
    """Yield a field of each of a list."""
    number = 0
    while (path := f"{where}.{number}.{name}") in found:
        yield found[path]
        number += 1


def devices(found: Flat) -> set[str]:
    """Return the hosts that have light."""
    return {path.split(".")[2] for path in found if path.startswith("dispatcher.devices.")}


def fibers_between(found: Flat, one: str, other: str) -> int:
    ends = [list(numbered(found, "dispatcher.fibers", f"{end}.node")) for end in "ab"]
    return sum({*pair} == {one, other} for pair in zip(*ends, strict=True))


def sources(found: Flat) -> set[str]:
    return {found[f"{host}.source"] for host in devices(found)}


DELAY_S = 20.4e3 / 2.04e8  # of 20.4 km
# Words on the command line, and what is so of the configurations then, and else is not.
CASES: dict[str, tuple[list[str], Callable[[Flat], bool]]] = {
    "controller": (
        ["--controller", "os-ken"],
        lambda found: found["controller.framework"] == "os-ken",
    ),
    "openflow_port": (
        ["--openflow-port", "7000"],
        lambda found: (
            (found["controller.listen"], found["q1.controllers"])
            == ("0.0.0.0:7000", ["198.18.1.1:7000"])
        ),
    ),
    "copper_km": (["--copper-km", "20.4"], lambda found: cables(found, "delay_s") == [DELAY_S] * 6),
    "copper_mbps": (["--copper-mbps", "7"], lambda found: cables(found, "mbps").count(7.0) == 5),
    "control_km": (
        ["--control-km", "20.4"],
        lambda found: cables(found, "delay_s") == [DELAY_S] * 2,
    ),
    "control_loss": (["--control-loss", "0.25"], lambda found: cables(found, "loss") == [0.25] * 2),
    "controller_delay": (
        ["--controller-delay", "1ms"],
        lambda found: cables(found, "a_software") == ["1ms"] * 2,
    ),
    "host_delay": (
        ["--host-delay", "1ms"],
        lambda found: cables(found, "a_software").count("1ms") == len(HOSTS),
    ),
    "switch_agent_delay": (
        ["--switch-agent-delay", "1ms"],
        lambda found: "1ms" in cables(found, "a_software") + cables(found, "b_software"),
    ),
    "tls": (
        ["--tls"],
        lambda found: (
            all(f"{name}.credentials.private_key" in found for name in (*HOSTS, "dispatcher", "q1"))
            and found["controller.listen"].startswith("127.0.0.1:")
        ),
    ),
    "keys": (["--keys", "KEYS"], lambda found: found["bob.keys"].endswith("/KEYS/bob")),
    "metrics": (
        ["--metrics"],
        lambda found: (
            None not in [found[f"{name}.metrics_fd"] for name in ("dispatcher", "controller", "q1")]
        ),
    ),
    "gnmi": (["--gnmi"], lambda found: bool(found["q1.gnmi"]) and found["q1.gnmi_fd"] is not None),
    "seed": (
        ["--seed", "7"],
        lambda found: {found[f"{name}.seed"] for name in (*HOSTS, "dispatcher", "copper")} == {7},
    ),
    "time": (
        ["--time", "paced=3"],
        lambda found: {v for path, v in found.items() if path.endswith("time_scale")} == {3.0},
    ),
    "channels": (
        ["--channels", "2"],
        lambda found: [*numbered(found, "dispatcher.fibers", "channel")] == [1, 2] * 5,
    ),
    "map": (
        ["--topology", MAP],
        lambda found: len(switches_of(found)) == 12,
    ),  # of SNDlib's Abilene
    "hosts_at": (
        ["--topology", f"{MAP},hosts_at=dnvrng,sttlng"],
        lambda found: devices(found) == {"dnvrng", "sttlng", "src"},
    ),
    "sources_at": (
        ["--topology", f"{MAP},sources_at=dnvrng,sttlng"],
        lambda found: sources(found) == {"src1", "src2"},
    ),
    "fibers": (
        ["--topology", "chain,fibers=5"],
        lambda found: fibers_between(found, "q1", "q2") == 5,
    ),
    "repeaters": (
        ["--topology", "repeaters,3"],
        lambda found: {"r1", "r2", "r3"} <= devices(found),
    ),
    "hosts": (["--topology", "tree,5"], lambda found: len(devices(found)) == 5),
    "switches": (
        ["--topology", "ring,5"],
        lambda found: switches_of(found) == {"q1", "q2", "q3", "q4", "q5"},
    ),
    "leaves": (
        ["--topology", "leaf-spine,4"],
        lambda found: len(switches_of(found)) == 6,
    ),
    "spines": (
        ["--topology", "leaf-spine,spines=3"],
        lambda found: len(switches_of(found)) == 6,
    ),
    "both_ways": (
        ["--topology", "sdc,both_ways"],
        lambda found: fibers_between(found, "alice", "q1") == 2,
    ),
}


@pytest.mark.parametrize("name", CASES)
def test_an_option_does_in_configurations_what_it_is_for(name: str) -> None:
    words, holds = CASES[name]
    words = [str(folder() / "KEYS") if word == "KEYS" else word for word in words]
    assert holds(flat(configurations(*words)))
    if words[0] == "--topology":
        without = ["--topology", words[1].split(",")[0]]
    else:
        without = words[: words.index(f"--{name.replace('_', '-')}")]
    assert name == "map" or not holds(flat(configurations(*without)))


@pytest.mark.parametrize("kept", [(True, False, False), (False, True, False), (False, False, True)])
def test_a_run_keeps_of_its_light_what_is_asked_for(kept: tuple[bool, bool, bool]) -> None:
    record, qasm, events = kept
    found = configurations(record=record, qasm=qasm, events=events)["dispatcher"]
    files = [found[name] != "" for name in ("record", "qasm", "event_log", "event_capture")]
    assert files == [record, qasm, events, events]


@pytest.mark.parametrize(("fibers", "period_s"), [(2, 5.0), (85, 7.0)])
def test_fibres_are_announced_the_more_rarely_the_more_there_are(
    fibers: int, period_s: float
) -> None:
    """25 a second of 2 x 85 between switches and 5 to hosts; each every 5 s if there are few."""
    found = flat(configurations("--topology", f"chain,fibers={fibers}"))
    periods = {path.partition(".")[0] for path in found if path.endswith(".announcement_period_s")}
    assert periods == {*HOSTS, "controller"}
    assert {found[f"{name}.announcement_period_s"] for name in periods} == {period_s}


def test_every_option_is_tried() -> None:
    tried = CASES.keys() | OF_FIBERS | {name for _program, name in OF_PROGRAMS}
    assert OPTIONS.keys() - tried == ELSEWHERE.keys()
