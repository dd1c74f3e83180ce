"""Pairs that wait for packets, a controller or a switch, in memories (after arXiv:2411.07410)."""

import math
from collections.abc import Sequence
from itertools import product

import numpy as np

from evidence.curves.estimates import Estimate
from evidence.labs.lab import Chart, Finding, Lab, Published, Runs
from wire.parameters.fiber import SPEED_IN_FIBER_M_PER_S

# Delays from 1 us to 100 ms, and T2 of all memories in delays.
T2_IN_DELAYS = {1e-6: 20.0, 1e-5: 10.0, 1e-4: 5.0, 1e-3: 8.0, 1e-2: 15.0, 1e-1: 30.0}
LENGTH_KM, RATE_HZ = 0.001, 4_000_000_000  # of each fibre, and of the sources
FLIGHT_S = LENGTH_KM * 1e3 / SPEED_IN_FIBER_M_PER_S
# Of all halves of a pair together, from when they leave until their pair is measured.
#
# copper: the source sends alice a message, she sends bob one, he replies with what both have, and
# she replies which pairs she has measured: hers wait for three messages, his for four.
# controller: bob's halves leave a message after alice's, their heralds take another, and outcomes a
# third: alice's wait for three, bob's for two, and those in memories of the switch for two and one.
# switch: all four wait until light is led from the memories to the analyser.
DELAYS = {"copper": 7, "controller": 8, "switch": 4}
# Halves in the switch wait until a block is stored, those at hosts also until both have met.
BLOCKS = {"copper": 0, "controller": 4, "switch": 4}
FLIGHTS = {"copper": 0, "controller": 21, "switch": 16}  # of light and messages
CONFIDENCE_95 = 1.959964  # standard errors
FIGURE = "fidelity"


def command_for(kind: str, delay_s: float) -> str:
    """Return the words behind `qmn`: all pairs are of one block."""
    run = "swap --topology chain,1 --count 4000"
    memories = f"--switch memory.t2_s={t2_s(delay_s):g}"
    slow = f"--controller-delay {delay_s * 1e9:.0f}ns --switch switching_time_s=0"
    if kind == "copper":
        run, memories = "distribute --count 8000", ""
        slow = f"--copper-km {delay_s / 2 * SPEED_IN_FIBER_M_PER_S / 1e3:.9g}"
    elif kind == "switch":
        slow = f"--switch switching_time_s={delay_s:g}"
    for host in ("alice", "bob"):
        memories += f" --device {host}.memory.t2_s={t2_s(delay_s):g}"
    return (
        f"run {run} --purification none --sample 0.5 --rate-hz {RATE_HZ} --length-km {LENGTH_KM:g}"
        f" {slow} {memories} --captures none --without report,record"
    )


def t2_s(delay_s: float) -> float:
    return T2_IN_DELAYS[delay_s] * delay_s


def waits(kind: str, delay_s: float, photons: int) -> float:
    """Return for how many T2 halves wait, as dephasing averages it over a block.

    At both hosts the first photon waits until the last has come.
    """
    at_host_s = np.arange(photons) / RATE_HZ
    fixed_s = DELAYS[kind] * delay_s + FLIGHTS[kind] * FLIGHT_S + BLOCKS[kind] * photons / RATE_HZ
    coherent = np.exp(-(fixed_s + 2 * at_host_s) / t2_s(delay_s))
    return -math.log(float(coherent.mean()))


def fidelity(waited: float) -> float:
    return (1 + math.exp(-waited)) / 2


def findings(runs: Runs) -> Sequence[Finding]:
    """Return the fidelity of each run, beside the closed form."""
    rows = []
    for kind, delay_s in product(DELAYS, T2_IN_DELAYS):
        result = runs[name(kind, delay_s)].job.asking
        waited = waits(kind, delay_s, result.emitted)
        error = (result.fidelity_high - result.fidelity_low) / 2 / CONFIDENCE_95
        theory = Published(fidelity(waited), 0.0, "(1 + exp(-t / T2)) / 2")
        text = f"F, {kind} of {delay_s * 1e3:g} ms, T2 of {t2_s(delay_s) * 1e3:g} ms"
        rows.append(Finding(FIGURE, text, Estimate(result.fidelity, error), theory, waited))
    return rows


def name(kind: str, delay_s: float) -> str:
    return f"{kind}-{delay_s:g}-s"


LAB = Lab(
    title="fidelity over delays of copper, controller and switches",
    paper="Vasan et al., Control Protocol for Entangled Pair Verification in Quantum Optical "
    "Networks (2024), arXiv:2411.07410",
    runs={name(*each): command_for(*each) for each in product(DELAYS, T2_IN_DELAYS)},
    findings=findings,
    theirs="closed form",
    charts=[Chart(FIGURE, "delays of 1 us to 100 ms", "wait (T2)", "F", fidelity)],
)
