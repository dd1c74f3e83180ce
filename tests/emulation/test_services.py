"""Services over a real network: asked for by metadata, arbitrated, captured like any other."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from conftest import ROOT


def run_service(runs: Path, *words: str) -> dict[str, Any]:
    """Run a service; return its result."""
    command = [sys.executable, "-m", "qmn", "run", *words, "--runs", str(runs)]
    done = subprocess.run(
        command, cwd=ROOT, capture_output=True, text=True, check=False, timeout=90
    )
    assert done.returncode == 0, done.stdout + done.stderr
    result: dict[str, Any] = json.loads((runs / "latest" / "result.json").read_text())
    return result


def shown(capture: Path, script: Path, wanted: str) -> list[str]:
    """Return what tshark shows of the packets of a filter."""
    command = ["tshark", "-r", str(capture), "-X", f"lua_script:{script}", "-Y", wanted]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=60)
    return done.stdout.splitlines()


@pytest.mark.parametrize("controller", ["ryu", "os-ken"])
def test_states_are_teleported(tmp_path: Path, controller: str) -> None:
    noise = ("--depolarizing", "0.01", "--controller", controller)
    result = run_service(tmp_path, "teleport", "--count", "40000", *noise)
    assert result["delivered"]
    told = result["asking"]
    assert told["states"] == told["arrived"] == 40_000
    pair = (1 + 3 * 0.99**4) / 4  # each half passes two fibres
    assert abs(told["fidelity"] - (2 * pair + 1) / 3) < 5 * told["fidelity_error"]
    assert told["waited_ms"] > 0
    assert {name: result["asked"][name] for name in ("arrived", "fidelity")} == {
        name: told[name] for name in ("arrived", "fidelity")
    }
    folder = tmp_path / "latest"
    script = folder / "qmn.lua"
    assert shown(folder / "all.pcapng", script, 'qmeta.service == "TELEPORT"')
    assert shown(folder / "all.pcapng", script, 'qmeta.topic == "CORRECTIONS"')
    assert "Setup TELEPORT" in (folder / "report.html").read_text()


def test_states_are_teleported_over_two_switches(tmp_path: Path) -> None:
    result = run_service(tmp_path, "teleport", "--topology", "chain", "--switches", "2")
    assert result["asking"]["fidelity"] == 1
    assert result["path_setup_ms"]["n"] == 1


def test_a_policy_may_allow_one_service_and_no_other(tmp_path: Path) -> None:
    policy = tmp_path / "policy.toml"
    policy.write_text('default = "deny"\n[[rule]]\naction = "allow"\nservice = "teleport"\n')
    words = ("--policy", str(policy))
    assert run_service(tmp_path, "teleport", "--count", "100", *words)["delivered"]
    command = [sys.executable, "-m", "qmn", "run", "sdc", "--runs", str(tmp_path), *words]
    done = subprocess.run(
        command, cwd=ROOT, capture_output=True, text=True, check=False, timeout=90
    )
    assert done.returncode == 1
    assert "policy does not allow" in done.stderr
