"""Services over a real network: asked for by metadata, arbitrated, captured like any other."""

import json
import subprocess
from collections.abc import Iterator
from datetime import datetime
from pathlib import Path
from typing import Any

import pytest
from conftest import TSHARK, policy
from fabric_scene import served, session
from limits import SOON_S
from loaded import run_qmn
from test_results_fit_schema import require_schema

from hosts.stack_socket import QuantumSocketError
from topologies.networks.network import Network


def run_service(runs: Path, *words: str, report: bool = False) -> dict[str, Any]:
    """Run a service; return its result."""
    reply = [] if report else ["--without", "report"]
    done = run_qmn("run", *words, "--runs", str(runs), *reply)
    assert done.returncode == 0, done.stdout + done.stderr
    require_schema(runs / "latest")
    result: dict[str, Any] = json.loads((runs / "latest" / "result.json").read_text())
    return result


def events(folder: Path) -> Iterator[tuple[str, str, int]]:
    """Yield node, kind and time (ns) of what happened to the qubits."""
    for line in (folder / "quantum.log").read_text().splitlines():
        time, node, kind, *_rest = line.split()
        seconds, fraction = time.rstrip("Z").split(".")
        whole_s = datetime.fromisoformat(f"{seconds}+00:00").timestamp()
        yield node, kind, int(whole_s) * 10**9 + int(fraction)


def shown(capture: Path, script: Path, wanted: str, *fields: str) -> list[str]:
    """Return what tshark shows of the packets of a filter, or fields of them."""
    command = [*TSHARK, "-r", str(capture), "-X", f"lua_script:{script}", "-Y", wanted]
    if fields:
        command += ["-T", "fields", *(word for field in fields for word in ("-e", field))]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=SOON_S)
    return done.stdout.splitlines()


@pytest.mark.by_day(every=2)
@pytest.mark.parametrize("controller", ["ryu", "os-ken"])
def test_states_are_teleported(tmp_path: Path, controller: str) -> None:
    noise = ("--depolarizing", "0.01", "--controller", controller)
    result = run_service(tmp_path, "teleport", "--count", "40000", *noise, report=True)
    assert result["delivered"]
    report = result["job"]["asking"]
    assert report["states"] == report["arrived"] == 40_000
    pair = (1 + 3 * 0.99**4) / 4  # each half passes two fibres
    assert abs(report["fidelity"] - (2 * pair + 1) / 3) < 5 * report["fidelity_error"]
    assert report["waited_ms"] > 0
    assert {name: result["job"]["asked"][name] for name in ("arrived", "fidelity")} == {
        name: report[name] for name in ("arrived", "fidelity")
    }
    folder = tmp_path / "latest"
    script = folder / "qmn.lua"
    assert shown(folder / "all.pcapng", script, 'qmeta.service == "TELEPORT"')
    assert shown(folder / "all.pcapng", script, 'qmeta.topic == "CORRECTIONS"')
    assert "Setup TELEPORT" in (folder / "report.html").read_text()
    seen = shown(folder / "all.pcapng", script, 'qmeta.topic == "CORRECTIONS"', "frame.time_epoch")
    applied = [
        time_ns for node, kind, time_ns in events(folder) if (node, kind) == ("bob", "apply")
    ]
    assert len(seen) == len(applied) == 3  # blocks
    for packet, done_ns in zip(seen, applied, strict=True):
        # The two bits were on the wire by then: at the same instant, as software takes no time.
        assert int(packet.replace(".", "")) <= done_ns


@pytest.mark.nightly
def test_any_state_is_teleported_on_dense(tmp_path: Path) -> None:
    words = ("teleport", "--backend", "dense", "--state", "haar", "--depolarizing", "0.02")
    report = run_service(tmp_path, *words)["job"]["asking"]
    pair = (1 + 3 * 0.98**4) / 4  # each half passes two fibres
    assert abs(report["fidelity"] - (2 * pair + 1) / 3) < 5 * report["fidelity_error"]
    result = json.loads((tmp_path / "latest" / "result.json").read_text())
    assert (result["backend"], result["exact"]) == ("dense", True)


def test_states_are_teleported_over_two_switches(chain_network: Network) -> None:
    report = served(chain_network, "teleport", "alice", "bob", count=1000)
    assert (report["states"], report["fidelity"]) == (1000, 1)


def test_a_policy_may_allow_one_service_and_no_other(shared_network: Network) -> None:
    text = 'default = "deny"\n[[rule]]\naction = "allow"\nservice = "teleport"\n'
    with policy(shared_network, text):
        assert served(shared_network, "teleport", "alice", "bob", count=100)["states"] == 100
        refused = pytest.raises(QuantumSocketError, match="policy does not allow")
        with refused, session(shared_network, "alice", "bob"):
            pass
