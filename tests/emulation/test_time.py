"""Time in a whole network: nothing outruns light, and a busy machine does not change physics."""

import json
import math
import os
import re
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import datetime
from pathlib import Path
from typing import Any

import pytest
from loaded import run_qmn
from scapy.layers.inet import ICMP
from scapy.utils import rdpcap

from qmn.scripting import start
from wire.config import DISPATCHER_PORT
from wire.metadata.header import METADATA_PORT

LIGHT_M_PER_S = 2.04e8
ECHO_REQUEST, ECHO_REPLY = 8, 0
SLOW_S = 150
STATES, RATE_HZ = 8000, 50_000_000

CONNECT = f"""
import socket
with socket.create_connection(("10.0.0.2", {METADATA_PORT})):
    print("connected")
"""

EMISSIONS = 3
EMIT = f"""
import asyncio, sys, time
from hosts.hardware import pair_light
from hosts.hardware.qnic import Qnic
from hosts.hardware.simulated import SimulatedQnic
from hosts.hardware.steps import Pulses

async def emit(dispatcher, token, *ports):
    qnic = SimulatedQnic(dispatcher, token, list(ports))
    for number in range({EMISSIONS}):
        began_s = time.monotonic()
        await pair_light.emit_pairs(qnic, 7, number, 10, ports, Pulses(1_000_000_000, 1_550_000))
        print(time.monotonic() - began_s)
    await qnic.close()

asyncio.run(emit(*sys.argv[1:]))
"""


def moments(folder: Path, kind: str, count: int) -> list[datetime]:
    """Wait until a run has a number of charlie's events of a kind; return their times."""
    until_s = time.monotonic() + SLOW_S
    while True:
        lines = [line.split() for line in (folder / "quantum.log").read_text().splitlines()]
        found = [words[0] for words in lines if words[1:3] == ["charlie", kind]]
        if len(found) == count or time.monotonic() > until_s:
            assert len(found) == count
            return [datetime.fromisoformat(each[:26]) for each in found]
        time.sleep(0.05)


def one_way_s(kilometres: float) -> float:
    return kilometres * 1e3 / LIGHT_M_PER_S


def fastest_ping_s(host: Any, address: str) -> float:
    """Return the shortest of several round trips."""
    output = host.cmd(f"ping -c 8 -i 0.05 -W 20 -q {address}")
    found = re.search(r"min/avg/max/mdev = ([\d.]+)/", output)
    assert found, output
    return float(found[1]) / 1e3


def echoes(capture: Path, kind: int) -> dict[int, float]:
    """Return when ICMP echoes of a kind passed, by their sequence number."""
    packets = [packet for packet in rdpcap(str(capture)) if ICMP in packet]
    return {each[ICMP].seq: float(each.time) for each in packets if each[ICMP].type == kind}


def test_a_ping_over_4000_km_takes_as_long_as_light_there_and_back(tmp_path: Path) -> None:
    with start("sdc", folder=tmp_path, length_km=2000.0, time="paced") as network:
        (at_s1,) = (file for file in network.capture("s1") if file.stem == "s1-eth1")
        alice = network.host("alice")
        assert fastest_ping_s(alice, "10.0.0.2") >= 2 * one_way_s(4000)
    # s1 is at q1, half way between alice and bob: what it passes on comes back over 2 x 2000 km.
    asked, answered = echoes(at_s1, ECHO_REQUEST), echoes(at_s1, ECHO_REPLY)
    assert asked.keys() & answered.keys()
    for number in asked.keys() & answered.keys():
        assert answered[number] - asked[number] >= 2 * one_way_s(2000)
    assert json.loads((tmp_path / "result.json").read_text())["acausal"] is None


def test_paced_copper_takes_as_long_as_the_scale_says() -> None:
    with start("sdc", length_km=200.0, time="paced=5") as network:
        assert fastest_ping_s(network.host("alice"), "10.0.0.2") >= 5 * 2 * one_way_s(400)


@pytest.mark.nightly
def test_copper_that_is_too_short_for_light_is_marked(tmp_path: Path) -> None:
    """Without any copper, bob hears what alice has measured 4000 km before light could tell."""
    with start("sdc", folder=tmp_path, length_km=2000.0, copper_km=0.0):
        pass
    report = json.loads((tmp_path / "result.json").read_text())["acausal"]
    assert report["early_s"] == pytest.approx(one_way_s(4000))
    assert {report["origin"], report["receiver"]} < {"alice", "bob", "charlie"}


def test_light_lost_at_a_far_switch_is_known_when_news_is_back(tmp_path: Path) -> None:
    """q1 is 2000 km from charlie, and has no path: news comes after 50 x 2 x 9.8 ms here.

    The sender has its answer earlier, when the light has left, without that news.
    """
    with start("sdc", folder=tmp_path, length_km=2000.0, time="paced=50") as network:
        script = network.runtime.logs.parent / "emit.py"  # the run's folder is not for hosts
        script.write_text(EMIT)
        ed = f"{network.host('ed').IP()}:{DISPATCHER_PORT}"
        words = f"{ed} {network.runtime.token('charlie')} charlie-q0 charlie-q1"
        output = network.host("charlie").cmd(f"{sys.executable} {script} {words}")
        sent, dark = (moments(tmp_path, kind, 2 * EMISSIONS) for kind in ("send", "dark"))
    took_s = [float(line) for line in output.splitlines()]
    assert len(took_s) == EMISSIONS
    back_s = 50 * 2 * one_way_s(2000)
    assert min(took_s) < back_s
    waited_s = [(known - left).total_seconds() for left, known in zip(sent, dark, strict=True)]
    assert back_s <= min(waited_s) < 2 * back_s


@contextmanager
def busy_machine() -> Iterator[None]:
    """Keep all processors busy."""
    command = [sys.executable, "-c", "while True: pass"]
    loops = [subprocess.Popen(command) for _ in range(os.cpu_count() or 1)]
    try:
        yield
    finally:
        for loop in loops:
            loop.kill()
            loop.wait()


def teleported(runs: Path, length_km: float, t2_s: float) -> dict[str, Any]:
    words = ["--length-km", str(length_km), "--device", f"bob.memory.t2_s={t2_s}"]
    words += [
        "--count",
        str(STATES),
        "--rate-hz",
        str(RATE_HZ),
        "--seed",
        "5",
        "--time",
        "paced=4000",
    ]
    done = run_qmn(
        "run", "teleport", *words, "--without", "report", "--runs", str(runs), timeout_s=SLOW_S
    )
    assert done.returncode == 0, done.stdout + done.stderr
    result: dict[str, Any] = json.loads((runs / "latest" / "result.json").read_text())
    return result


@pytest.mark.nightly
@pytest.mark.timeout(2 * SLOW_S)
def test_a_busy_machine_does_not_change_what_waiting_does_to_qubits(tmp_path: Path) -> None:
    """Bob's photons wait for a message over as much copper as light has passed of fibre.

    alice measures when light has come to both, and tells bob. The six states
    keep their Z, and X and Y with exp(-t / T2): F = 1 - (1 - exp(-t / T2)) / 3, in the mean over
    photons that come one after the other, of which the last waits shortest. Half a second of
    software here, which is .125 ms there, changes that by .003.
    """
    length_km, t2_s = 40.0, 0.0125
    waits_s, train_s = one_way_s(2 * length_km), STATES / RATE_HZ
    kept = math.exp(-waits_s / t2_s) * (1 - math.exp(-train_s / t2_s)) * t2_s / train_s
    expected = 1 - (1 - kept) / 3
    quiet = teleported(tmp_path / "quiet", length_km, t2_s)
    with busy_machine():
        busy = teleported(tmp_path / "busy", length_km, t2_s)
    for result in (quiet, busy):
        report = result["job"]["asking"]
        assert report["states"] == report["arrived"] == STATES
        assert abs(report["fidelity"] - expected) < 5 * math.sqrt(
            expected * (1 - expected) / STATES
        )
        assert report["waited_ms"] / 1e3 >= waits_s - 1e-6
        assert result["time_scale"] == 4000
    difference = quiet["job"]["asking"]["fidelity"] - busy["job"]["asking"]["fidelity"]
    assert abs(difference) < 5 * math.sqrt(2 * expected * (1 - expected) / STATES)
