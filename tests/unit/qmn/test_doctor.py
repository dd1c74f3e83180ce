"""qmn doctor on this machine, whatever it has, and on one that lacks things."""

import json
import os
import subprocess
import sys
from typing import Any

import pytest
from limits import SOON_S

import qmn.project
from qmn.running import machine
from qmn.running.machine import FAILS, LIMITED, UNCHECKED, WORKS, Finding
from qmn.verbs import doctor
from topologies.system import namespaces
from topologies.system.namespaces import RunningRun


def run(*words: str, **environment: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "qmn", "doctor", *words],
        capture_output=True,
        text=True,
        check=False,
        timeout=SOON_S,
        env={**os.environ, **environment},
    )


def findings(done: subprocess.CompletedProcess[str]) -> dict[str, dict[str, Any]]:
    assert done.stderr == ""
    return {finding["name"]: finding for finding in json.loads(done.stdout)}


def test_every_finding_says_what_to_do_unless_it_works() -> None:
    done = run("--json")
    found = findings(done)
    assert {"user", "packages", "Open vSwitch", "Docker", "running networks"} <= set(found)
    for finding in found.values():
        assert finding["state"] in (WORKS, LIMITED, FAILS, UNCHECKED)
        assert finding["found"]
        assert bool(finding["remedy"]) == (finding["state"] != WORKS), finding
    assert done.returncode == int(any(item["state"] == FAILS for item in found.values()))


def test_a_machine_without_anything_fails() -> None:
    done = run("--json", PATH="/nonexistent")
    found = findings(done)
    assert done.returncode == 1
    assert found["Open vSwitch"]["state"] == FAILS
    assert found["Open vSwitch"]["remedy"] == "run `make setup`"
    assert found["packages"]["state"] == LIMITED


def test_kernel_features_are_tried_and_leave_nothing() -> None:
    found = list(machine.kernel())
    assert not {"v0", "v1", "t0"} & set(os.listdir("/sys/class/net"))
    wanted = {WORKS, LIMITED, FAILS} if os.geteuid() == 0 else {UNCHECKED}
    assert {finding.state for finding in found} <= wanted


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can try")
def test_a_feature_that_is_not_there_is_told() -> None:
    finding = machine._tried("warp", LIMITED, ["ip", "link", "add", "w", "type", "warp"], "none")
    assert finding.state == LIMITED
    assert finding.found


def test_a_missing_package_is_named(monkeypatch: pytest.MonkeyPatch, tmp_path: Any) -> None:
    (tmp_path / "apt-packages.txt").write_text("python3\nno-such-package\n")
    monkeypatch.setattr(machine, "ROOT", tmp_path)
    finding = machine.packages()
    assert (finding.state, finding.found) == (FAILS, "missing: no-such-package")


def test_a_missing_python_package_is_named(monkeypatch: pytest.MonkeyPatch, tmp_path: Any) -> None:
    wanted = '"rich", "no-such-package[extra]>=4.2"'
    (tmp_path / "pyproject.toml").write_text(f"[project]\ndependencies = [{wanted}]\n")
    assert machine.python_packages().state == WORKS
    monkeypatch.setattr(qmn.project, "ROOT", tmp_path)
    finding = machine.python_packages()
    assert (finding.state, finding.found) == (FAILS, "missing: no-such-package")


def test_running_networks_are_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(namespaces, "running", list)
    assert machine.running_networks().found == "none"
    two = [RunningRun(7, 8, "qmn cli sdc"), RunningRun(9, 10, "qmn run bb84")]
    monkeypatch.setattr(namespaces, "running", lambda: two)
    assert machine.running_networks().found == "7 (qmn cli sdc), 9 (qmn run bb84)"


def test_people_read_state_name_and_remedy(capsys: pytest.CaptureFixture[str]) -> None:
    doctor.show([Finding("netem", LIMITED, "not [there]", "use [another] kernel")])
    assert capsys.readouterr().out == (
        "limited   netem: not [there]\n          -> use [another] kernel\n"
    )
