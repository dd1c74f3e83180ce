"""The parameters of kinds of nodes, and their refusals."""

import shlex
import subprocess
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from topologies.nodes import OpticalSwitch, QuantumHost
from topologies.system.confinement import confinement
from topologies.system.confinement.confinement import ConfinedNode
from topologies.system.machines.node import NodeElsewhere
from topologies.system.runs import runtime
from topologies.system.runs.runtime import Runtime
from wire.parameters.physics import (
    BadParameter,
    BellAnalyser,
    Detectors,
    Device,
    Gates,
    Memory,
    PairSource,
)
from wire.parameters.switch import PathOptics


@pytest.mark.parametrize(
    ("optics", "message"),
    [
        ({"rotation": 7}, "q1: rotation 7: choose 0 to 3"),
        ({"crosstalk_db": -40.0}, "q1: crosstalk_db -40.0: choose 0 to 100"),
        ({"paths": [PathOptics(1, 2, -1.0)]}, "path 1 -> 2: insertion_loss_db -1.0"),
        ({"max_temperature_c": float("nan")}, "max_temperature_c nan"),
        ({"grid_mhz": 0}, "grid_mhz 0"),
        ({"insertion_los_db": 9.0}, "q1 has no insertion_los_db: did you mean insertion_loss_db"),
        ({"controller_port": 0}, "q1: controller_port 0: choose 1 to 65535"),
        ({"controller_port": 65536}, "q1: controller_port 65536: choose 1 to 65535"),
    ],
)
def test_optics_that_cannot_be_are_refused_before_a_switch_is_made(
    optics: dict[str, Any], message: str
) -> None:
    with pytest.raises(BadParameter, match=message):
        OpticalSwitch("q1", **optics)


@pytest.mark.parametrize(
    ("hardware", "message"),
    [
        ({"detectors": Detectors(efficiency=1.1)}, "bob, detectors: efficiency 1.1: choose 0 to 1"),
        ({"device": Device(memory=Memory(capacity=-1))}, "bob, memory: capacity -1"),
        ({"source": PairSource(fidelity=0.1)}, "bob, source: fidelity 0.1: choose 0.25 to 1"),
        ({"detectors": 0.9}, "bob: detectors 0.9 is not a Detectors"),
        ({"device": Detectors()}, "is not a Device"),
    ],
)
def test_hardware_that_cannot_be_is_refused_before_a_host_is_made(
    hardware: dict[str, Any], message: str
) -> None:
    with pytest.raises(BadParameter, match=message):
        QuantumHost("bob", ip="10.0.0.2/24", **hardware)


def test_parts_of_a_hosts_hardware_replace_those_of_its_device(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(runtime, "RUNTIME_ROOT", tmp_path)
    monkeypatch.setattr(runtime, "_current", Runtime())
    QuantumHost(
        "bob",
        ip="10.0.0.2/24",
        inNamespace=False,
        source=PairSource(fidelity=0.9),
        device=Device(memory=Memory(capacity=5), detectors=Detectors(efficiency=0.5)),
        detectors=Detectors(efficiency=0.8),
        analyser=BellAnalyser("linear"),
        gates=Gates("paulis"),
    ).terminate()
    network = runtime.current()
    assert network.source == "bob"
    assert network.devices["bob"] == Device(
        PairSource(fidelity=0.9),
        Memory(capacity=5),
        Detectors(efficiency=0.8),
        BellAnalyser("linear"),
        Gates("paulis"),
    )


@pytest.mark.parametrize("kind", [ConfinedNode, NodeElsewhere])
def test_root_of_a_host_without_a_user_namespace_cannot_take_limits_off(
    kind: type[ConfinedNode | NodeElsewhere], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A process with SYS_RESOURCE raises hard limits: capabilities(7)."""
    reports: list[str] = []
    machine = SimpleNamespace(root="/qmn", ask=lambda *_, **__: [], put=lambda *_: None)
    node: Any = SimpleNamespace(
        name="bob",
        machine=machine,
        write=reports.append,
        await_shell=lambda *_: None,
        shell=SimpleNamespace(pid=1, user=None),
        _user=None,
        _admit=lambda _pid: None,
    )
    monkeypatch.setattr(confinement, "children", lambda _pid: [2])
    monkeypatch.setattr(
        "topologies.system.confinement.confinement.MemoryGroup.of_host", lambda *_: None
    )
    kind.confine(node, {}, [], tmp_path / "fstab", 64)
    words = shlex.split(reports[0])
    given_up = words[words.index("bob") + 2].split(",")
    assert {"-sys_admin", "-sys_resource", "-dac_read_search", "-sys_module"} <= set(given_up)
    assert words[words.index("bob") + 1] == str(64 << 10)  # KiB, as ulimit(1p) takes them


def test_a_program_of_a_host_without_a_user_namespace_has_the_powers_and_memory_of_its_shell() -> (
    None
):
    node: Any = SimpleNamespace(_confined=7, _user=None, _memory_bytes=64 << 20)
    enter = ConfinedNode._enter(node, "/")
    assert enter[enter.index("setpriv") :] == ["setpriv", f"--bounding-set={confinement.GIVEN_UP}"]
    limited = enter[enter.index("prlimit") : enter.index("setpriv")]
    output = subprocess.run([*limited, "sh", "-c", "ulimit -d"], capture_output=True, check=True)
    assert int(output.stdout) == 64 << 10  # in KiB
