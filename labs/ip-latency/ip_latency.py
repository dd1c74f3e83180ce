"""Pairs in memories until packets of an IP network have told what came (after arXiv:2411.07410)."""

import math
from collections.abc import Sequence
from functools import partial
from itertools import product

from evidence.curves.estimates import Estimate
from evidence.labs.lab import Chart, Finding, Lab, Published, Run, Runs, exactly
from wire.parameters.fiber import SPEED_IN_FIBER_M_PER_S

T2_S = {"nv-centre": 0.4, "ion-trap": 30.0}  # as docs/nodes.md has them
COPPER_KM = (500, 1000, 2000, 4000)  # of the cable of each host
# From when photons have come: the source tells alice, she tells bob, he tells her what both have;
# she measures then, and he when she has said which pairs.
TRIPS = 3 + 4
CONFIDENCE_95 = 1.959964  # standard errors
CHART = "fidelity-{}"


def latency_s(copper_km: float) -> float:
    return 2e3 * copper_km / SPEED_IN_FIBER_M_PER_S


def fidelity(t2_s: float, latency_ms: float) -> float:
    return (1 + math.exp(-TRIPS * latency_ms / 1e3 / t2_s)) / 2


def trip_ms(run: Run) -> float:
    return 1e3 * (sum(run.times_s("recall")) - sum(run.times_s("arrive"))) / TRIPS


def said(node: str, copper_km: int) -> str:
    """Return what is said behind `qmn`: all pairs come in one block."""
    memories = [f"--device {host}.memory.t2_s={T2_S[node]:g}" for host in ("alice", "bob")]
    return (
        "run distribute --purification none --count 8000 --sample 0.5 --time-scale 40"
        f" --copper-km {copper_km} {' '.join(memories)} --captures none --without report,record"
    )


def findings(runs: Runs) -> Sequence[Finding]:
    """Return the fidelity of pairs over the time of a trip, beside the closed form."""
    found, as_slow_as_light = [], 0
    for node, copper_km in product(T2_S, COPPER_KM):
        run = runs[f"{node}-{copper_km}-km"]
        told, took_ms = run.job.asking, trip_ms(run)
        latency_ms = 1e3 * latency_s(copper_km)
        error = (told.fidelity_high - told.fidelity_low) / 2 / CONFIDENCE_95
        theory = Published(fidelity(T2_S[node], took_ms), 0.0, "(1 + exp(-7 L / T2)) / 2")
        words = (
            f"F, T2 of {T2_S[node]:g} s, L of {latency_ms:.1f} ms, with software {took_ms:.1f} ms"
        )
        ours = Estimate(told.fidelity, error)
        found.append(Finding(CHART.format(node), words, ours, theory, took_ms))
        as_slow_as_light += took_ms >= latency_ms
    words = "runs whose packets were as slow as light, or slower"
    return [*found, exactly(words, as_slow_as_light, len(runs), "a count")]


LAB = Lab(
    title="fidelity over the latency of an IP network",
    paper="Vasan et al., Control Protocol for Entangled Pair Verification in Quantum Optical "
    "Networks (2024), arXiv:2411.07410",
    runs={f"{node}-{km}-km": said(node, km) for node, km in product(T2_S, COPPER_KM)},
    findings=findings,
    theirs="closed form",
    charts=[
        Chart(
            CHART.format(node),
            f"memories of T2 = {t2_s:g} s, as {node}",
            "from host to host, with software (ms)",
            "F",
            partial(fidelity, t2_s),
        )
        for node, t2_s in T2_S.items()
    ],
)
