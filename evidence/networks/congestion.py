"""Congestion on copper costs fidelity of teleportation.

    alice ---- copper, slow ---- s1 ---- copper, as slow ---- bob
      datagrams at random, which queue               their times
      two bits of each state, behind them            halves that wait for them in memory

Datagrams of one size come as a Poisson process and queue at alice for the slow copper: M/D/1, whose
mean wait is rho D / (2 (1 - rho)) (L. Kleinrock, Queueing Systems I, section 5.6). The bits of
teleportation queue among them, and bob's halves dephase as long as that takes.
"""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from evidence.curves import theory
from evidence.curves.estimates import Estimate, mean_of_series, proportion
from evidence.curves.experiment import Experiment, Measure, Outcome, number
from evidence.curves.parameters import Parameter, Values
from evidence.networks.datagrams import LEAST_FRAME_BYTES, MOST_FRAME_BYTES
from evidence.networks.point_network import network_for, session
from qmn.timeouts import EMULATED_READY_S
from topologies.networks.network import Signals
from topologies.system.processes.programs import python
from wire.network_time import SteppedTime

SHARE = Parameter("share", 0.5, 0.0, 0.95)
MBPS = Parameter("copper_mbps", 0.25, 0.1, 10.0, "Mbit/s")
FRAME = Parameter("frame_bytes", 1250, LEAST_FRAME_BYTES, MOST_FRAME_BYTES)
T2 = Parameter("memory_t2_s", 0.4, 1e-3, 1e6, "s")
BLOCKS = Parameter("blocks", 100, 20, 10_000)
ALONE = Parameter("alone_s", 30.0, 1.0, 600.0, "s")  # that datagrams pass before
WAITED = Parameter("measured_wait_s", 0.0)
BLOCK_STATES = 100  # their bits are one short packet
HEAR = "datagrams.heard"
PROGRAM = "evidence.networks.datagrams"


def measure(values: Values, seed: int, runs: Path, _signals: Signals) -> Outcome:
    """Teleport block after block while datagrams pass."""
    rate, share, size = (number(values, each.name) for each in (MBPS, SHARE, FRAME))
    frame_s = size * 8e-6 / rate
    memory = (f"bob.memory.t2_s={values[T2.name]}",)
    with network_for(
        CONGESTION, values, runs, "sdc", seed=seed, copper_mbps=rate, device=memory
    ) as network:
        time = network.runtime.time
        assert isinstance(time, SteppedTime)
        program = [python(), "-m", PROGRAM, time.folder]
        heard = network.run_on("bob", HEAR, [*program, "hear"])
        heard.wait_for("ready", EMULATED_READY_S, network.check)
        if share:
            arguments = ["say", network.host("bob").IP(), "--per-s", f"{share / frame_s}"]
            arguments += ["--frame-bytes", f"{size:.0f}", "--seed", f"{seed}"]
            network.run_on("alice", "datagrams.log", [*program, *arguments])
            network.sleep(number(values, ALONE.name))
        alone = heard.log.read_text().splitlines()[1:]
        count = int(values[BLOCKS.name]) * BLOCK_STATES
        ends = "alice", "bob"
        with session(network, "teleport", ends, count=count, block_pairs=BLOCK_STATES) as running:
            reports = running.results()
    return outcome(reports, alone, frame_s, number(values, T2.name))


def outcome(
    reports: Sequence[dict[str, Any]], alone: Sequence[str], frame_s: float, t2_s: float
) -> Outcome:
    """Return what was measured: of cumulated results of teleportation, and times of datagrams.

    These have passed alone, each a frame's time over either cable and what they have queued.
    """
    waits = waits_of(reports)
    last = reports[-1]
    times_ns = [tuple(map(int, line.split())) for line in alone]
    delays = [(came - sent) * 1e-9 for sent, came in times_ns]
    return {
        "queued": mean_of_series([delay - 2 * frame_s for delay in delays]),
        "wait": mean_of_series(waits),
        WAITED.name: Estimate(as_dephasing_averages(waits, t2_s), 0.0),
        "fidelity": proportion(round(last["fidelity"] * last["arrived"]), last["arrived"]),
        "teleported": proportion(round(last["fidelity"] * last["arrived"]), last["arrived"]),
    }


def waits_of(reports: Sequence[dict[str, Any]]) -> list[float]:
    """Return how long (s) each block has waited, of means over all blocks so far."""
    sums = [0.0, *(report["arrived"] * report["waited_ms"] / 1e3 for report in reports)]
    counts = [0, *(report["arrived"] for report in reports)]
    pairs = zip(sums, sums[1:], counts, counts[1:], strict=False)
    return [(s1 - s0) / (n1 - n0) for s0, s1, n0, n1 in pairs if n1 > n0]


def as_dephasing_averages(waits_s: Sequence[float], t2_s: float) -> float:
    """Return the one wait that dephases as much as these do on average."""
    return -t2_s * math.log(sum(math.exp(-wait_s / t2_s) for wait_s in waits_s) / len(waits_s))


def queued(values: Values) -> float | None:
    share = number(values, SHARE.name)
    if not share:
        return None  # there are no datagrams
    frame_s = number(values, FRAME.name) * 8e-6 / number(values, MBPS.name)
    return share * frame_s / (2 * (1 - share))


def teleported(values: Values) -> float | None:
    return theory.waited_fidelity(number(values, WAITED.name), math.inf, number(values, T2.name), 0)


CONGESTION = Experiment(
    "congestion",
    "teleportation whose two bits queue on congested copper",
    (SHARE, MBPS, FRAME, T2, BLOCKS, ALONE),
    (
        Measure("queued", "mean time that datagrams queue for the copper (s): M/D/1", queued),
        Measure("wait", "mean wait of halves in memory for their two bits (s)"),
        Measure(WAITED.name, "wait in memory for the two bits, as dephasing averages it (s)"),
        Measure("fidelity", "average fidelity of the teleported state"),
        Measure("teleported", "average fidelity of the teleported state", teleported, over=WAITED),
    ),
)
