"""Time that stands while software runs: physics of microseconds, whatever the machine does."""

import json
import math
import re
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from limits import PROGRAM_S
from loaded import run_qmn

from topologies.system.processes.programs import ROOT

STATES, RATE_HZ, T2_S, KM = 10_000, 50_000_000, 0.01, 20.0
LIGHT_M_PER_S = 2.04e8
BUSY = 4  # programs
JOBS = (
    "sdc",
    "teleport --length-km 20 --device bob.memory.t2_s=0.01",
    "swap --topology chain,4",
    "qkd --protocol bb84",
    "ghz",
    "keys --seconds 30 --session-bits 10000 --high-mark 32",
    "distribute --node nv-centre --count 8 --sample 0 --length-km 0.01",
    "load --topology map,garr --sessions 5",
)
NAMES_OF_FOLDERS = {"captures", "timeline"}
# By the wall, by processor time, or lost by tcpdump where it gets no processor.
OF_MACHINE = {"began_ns", "controller_ms", "controller_ms_a_session", "packets_not_captured"}
TELEPORT = (
    *("teleport", "--count", str(STATES), "--rate-hz", str(RATE_HZ)),
    *("--length-km", str(KM), "--device", f"bob.memory.t2_s={T2_S}", "--time", "stepped"),
)


def result_of(folder: Path, *words: str) -> dict[str, Any]:
    """Run to the end, without a wrong leap; return the result."""
    done = run_qmn("run", *words, "--without", "report", "--runs", str(folder))
    assert not done.returncode, done.stdout + done.stderr
    leaps = re.search(r"stopped: ([\d,]+) leaps, 0 wrong", (folder / "latest/gate.log").read_text())
    assert leaps is not None
    result: dict[str, Any] = json.loads((folder / "latest/result.json").read_text())
    assert result["time"] == "stepped"
    return result


def facts(result: dict[str, Any]) -> dict[str, Any]:
    """Return a result without the names of its folder, and without what this machine took."""

    def left(fields: dict[str, Any]) -> dict[str, Any]:
        return {k: v for k, v in fields.items() if k not in NAMES_OF_FOLDERS | OF_MACHINE}

    kept: dict[str, Any] = json.loads(json.dumps(result), object_hook=left)
    return kept


@contextmanager
def busy_programs(number: int) -> Iterator[None]:
    """Let programs compute meanwhile."""
    with ExitStack() as programs:
        for _ in range(number):
            program = subprocess.Popen([sys.executable, "-c", "while True: pass"])
            programs.enter_context(program)
            programs.callback(program.kill)
        yield


def require_fidelity(asking: dict[str, Any], host_ms: int) -> None:
    """Dephasing for t flips four of the six states with probability (1 - exp(-t / T2)) / 2.

    The wait of photon i of n is exact: until the last of them has come, and then for alice's bits
    over two cables of 20 km, at the speed of light in a fibre. Software is stated for two messages:
    alice's of the source, which comes with the light, and bob's of alice.
    """
    wait_s = np.arange(STATES)[::-1] / RATE_HZ + 2 * KM * 1e3 / LIGHT_M_PER_S + 2 * host_ms / 1e3
    assert asking["waited_ms"] == pytest.approx(1e3 * wait_s.mean(), abs=1e-3)
    fidelity = 1 - (1 - np.exp(-wait_s / T2_S).mean()) / 3
    error = math.sqrt(fidelity * (1 - fidelity) / STATES)
    assert abs(asking["fidelity"] - fidelity) < 5 * error


def test_teleportation_has_the_fidelity_of_its_closed_form_and_the_same_by_the_same_seed(
    tmp_path: Path,
) -> None:
    one, other = (result_of(tmp_path / name, *TELEPORT) for name in ("one", "other"))
    require_fidelity(one["job"]["asking"], 0)
    assert facts(one) == facts(other)


def test_states_wait_for_the_software_of_hosts_as_long_as_is_stated(tmp_path: Path) -> None:
    result = result_of(tmp_path, *TELEPORT, "--host-delay", "5ms")
    require_fidelity(result["job"]["asking"], 5)


@pytest.mark.nightly
@pytest.mark.parametrize("job", JOBS, ids=[job.split()[0] for job in JOBS])
def test_the_same_seed_gives_the_same_result_beside_busy_programs(job: str, tmp_path: Path) -> None:
    """In namespaces of its own, where the gate does not see what makes the machine busy."""
    results: list[dict[str, Any]] = []
    for busy in (0, 0, BUSY, BUSY, BUSY):
        folder = tmp_path / str(len(results))
        words = ["run", *job.split(), "--time", "stepped", "--without", "report"]
        with busy_programs(busy):
            command = [str(ROOT / "bin/qmn"), *words, "--runs", str(folder)]
            subprocess.run(command, check=True, timeout=PROGRAM_S)
        results.append(facts(json.loads((folder / "latest/result.json").read_text())))
    for result in results[1:]:
        assert result == results[0]


def test_a_path_takes_as_long_to_set_up_as_controller_and_agents_are_stated_to_take(
    tmp_path: Path,
) -> None:
    """The controller's order takes q1's agent its time, and q1's answer the controller its own."""
    settings = ((), ("--controller-delay", "3ms", "--switch-agent-delay", "500us"))
    before, after = (result_of(tmp_path, "sdc", "--time", "stepped", *each) for each in settings)
    taken_ms = after["path_setup_ms"]["p50"] - before["path_setup_ms"]["p50"]
    assert taken_ms == pytest.approx(3.5, abs=1e-4)


def test_sessions_of_traffic_hold_light_as_long_as_planned_and_the_same_again(
    tmp_path: Path,
) -> None:
    """Light and messages take microseconds in this ring; requests that have to wait try again."""
    runs = []
    for name in ("one", "other"):
        words = ("load", "--time", "stepped", "--sessions", "4", "--without", "report")
        done = run_qmn("run", *words, "--runs", str(tmp_path / name))
        assert not done.returncode, done.stdout + done.stderr
        runs.append(json.loads((tmp_path / name / "latest/result.json").read_text()))
    one, other = (run["job"]["load"]["sessions"] for run in runs)
    assert any(session["outcome"] == "accepted" for session in one)
    for session, again in zip(one, other, strict=True):
        assert session["outcome"] == again["outcome"]
        if session["outcome"] == "accepted":
            assert session["setup_s"] == pytest.approx(again["setup_s"], abs=1e-8)
            held_s = session["ended_s"] - session["asked_s"] - session["setup_s"]
            assert held_s == pytest.approx(session["holding_s"], abs=1e-5)


def test_an_hour_of_keys_takes_no_hour_and_an_eavesdropper_comes_at_her_instant(
    tmp_path: Path,
) -> None:
    """The session after the first pause, of half a second, meets her, later ones do not."""
    result = result_of(
        tmp_path,
        *("keys", "--time", "stepped", "--seconds", "3600", "--session-bits", "10000"),
        *("--eve", "1", "--at", "0.4", "--until", "0.9", "--high-mark", "32"),
    )
    moments = result["job"]["time_series"]
    at = {each["event"]: each["at"] for each in moments}
    assert (at["eve_comes"], at["eve_leaves"]) == (0.4, 0.9)
    alarms = [each["at"] for each in moments if each["event"] == "alarm" and each["opened"]]
    assert alarms == pytest.approx([0.5], abs=1e-2)
    assert result["job"]["asking"]["elapsed_s"] == 3_600
    assert result["job"]["asking"]["keys"] >= 60


NETQASM = """
import time
from netqasm.sdk import EPRSocket
from netqasm.sdk.external import NetQASMConnection, Socket

def main(app_config=None, wait_s=0.0):
    own, other = app_config.app_name, "bob" if app_config.app_name == "alice" else "alice"
    texts, pairs = Socket(own, other), EPRSocket(other)
    outcomes, began_s = [], time.monotonic()
    for _ in range(10):
        with NetQASMConnection(own, epr_sockets=[pairs], max_qubits=10) as processor:
            halves = pairs.create_keep(10) if own == "alice" else pairs.recv_keep(10)
            processor.flush()
            time.sleep(wait_s)
            for half in halves:
                half.H()
            found = [half.measure() for half in halves]
            processor.flush()
            outcomes += [int(each) for each in found]
        texts.send("") if own == "bob" else texts.recv()
    return {"outcomes": outcomes, "took_s": time.monotonic() - began_s}
"""


def test_pauses_of_a_netqasm_program_dephase_what_waits_as_long_as_they_say(
    tmp_path: Path,
) -> None:
    """Halves of Phi+ agree along X with probability (1 + exp(-t / T2)) / 2 after t in a memory."""
    for role in ("alice", "bob"):
        (tmp_path / f"app_{role}.py").write_text(NETQASM)
    words = ("--time", "stepped", "--device", f"bob.memory.t2_s={T2_S}", "--runs")
    wait_s, runs = T2_S / 2, str(tmp_path / "runs")
    done = run_qmn("netqasm", str(tmp_path), "--input", f"bob.wait_s={wait_s}", *words, runs)
    assert not done.returncode, done.stdout + done.stderr
    assert "Warning" not in done.stdout
    (outputs,) = json.loads((tmp_path / "runs/latest/result.json").read_text())["job"]["outputs"]
    alice, bob = (np.array(outputs[role]["outcomes"]) for role in ("alice", "bob"))
    agree = (1 + math.exp(-wait_s / T2_S)) / 2
    assert abs((alice == bob).mean() - agree) < 5 * math.sqrt(agree * (1 - agree) / len(bob))
    assert outputs["bob"]["took_s"] == pytest.approx(10 * wait_s, rel=0.01)


SCRIPT = """
import sys
from qmn.scripting import start

with start("sdc", length_km=20, time="stepped", folder=sys.argv[1]) as network:
    time = network.runtime.time
    for sent in [*network.ping("alice", "bob", 3)][1:]:  # the first has addresses to find
        print(sent.setup_s)
    began_ns = time.now_ns()
    network.sleep(3_600)
    print((time.now_ns() - began_ns) / 1e9)
"""


def test_a_script_steps_its_network_and_sleeps_in_it(tmp_path: Path) -> None:
    """Each session is set up in the same time, and an hour of the network takes none here."""
    (tmp_path / "script.py").write_text(SCRIPT)
    done = run_qmn("script", str(tmp_path / "script.py"), str(tmp_path / "logs"))
    assert not done.returncode, done.stdout + done.stderr
    *set_up_s, hour_s = (float(line) for line in done.stdout.splitlines())
    assert set_up_s == pytest.approx([set_up_s[0]] * 2, abs=1e-9)
    assert hour_s == 3_600
    assert json.loads((tmp_path / "logs/result.json").read_text())["time"] == "stepped"
