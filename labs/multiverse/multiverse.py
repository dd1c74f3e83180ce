"""Swaps and purifications of pairs that wait, beside MQNS (arXiv:2512.22937)."""

import tomllib
from collections.abc import Iterator
from itertools import chain
from pathlib import Path
from typing import Any

from evidence.curves.estimates import Estimate, proportion
from evidence.labs.lab import Chart, Finding, Lab, Published, Run, Runs

THEIRS = tomllib.loads(Path(__file__).with_name("figures.toml").read_text())
FIGURES = {figure["name"]: figure for figure in THEIRS["figures"]}
CONFIDENCE_95 = 1.959964  # standard errors
FLIGHT_S = 200 / 2.04e5  # over a link
JOBS = {
    "swapped": "swap --topology chain,1 --length-km 200 --purification none",
    "swapped-twice": "swap --topology chain,2 --length-km 200 --purification none",
    "purified": "distribute --length-km 100 --purification bbpssw --rounds 1",
    "swapped-purified": "swap --topology chain,1 --length-km 200 --purification bbpssw --rounds 1",
}
ONE_BLOCK = "--rate-hz 4e9 --sample 0.9 --captures none --without report,record"


def command_for(figure: dict[str, Any]) -> str:
    """Return the words behind `qmn` for a figure; alice alone forgets if pairs are purified."""
    job, waits = figure["job"], figure.get("waits")
    pairs = f"--count {figure.get('pairs', 2000)} --block-pairs {figure['block']}"
    settings = [f"source.fidelity={figure['source']:g}"]
    if waits is not None:
        settings.append(f"memory.depolarizing_s={figure['flights'] * FLIGHT_S / waits:.6g}")
    command = f"run {JOBS[job]} {pairs} {ONE_BLOCK}"
    for setting in settings:
        host = "alice" if job == "purified" and setting.startswith("memory") else "*"
        command += f" --device {host}.{setting}"
        if job != "purified":
            command += f" --switch {setting}"
    return command


def waited_s(run: Run, figure: dict[str, Any]) -> dict[str, float]:
    """Return waits at alice before and after a purification; or of all halves of a swapped pair."""
    if figure["job"] == "purified":
        arrived, measured = run.times_s("arrive"), run.times_s("measure")
        return {"before": measured[0] - arrived[0], "after": measured[2] - measured[0]}
    asking, acceptor = run.job.asking, run.job.asked
    at_ends = asking.sampled_waited_ms + acceptor.sampled_waited_ms
    return {"of all": (at_ends + 2 * sum(acceptor.repeaters_waited_ms)) / 1e3}


def of_figure(figure: dict[str, Any], run: Run) -> Iterator[Finding]:
    asking, what = run.job.asking, figure["what"]
    program, waits = f"{THEIRS['program']}: {figure['from']}", figure.get("waits")
    error = (asking.fidelity_high - asking.fidelity_low) / 2 / CONFIDENCE_95
    theirs = Published(figure["fidelity"], 5e-7, program)
    yield Finding(figure["chart"], f"F, {what}", Estimate(asking.fidelity, error), theirs, waits)
    if "survived" in figure:
        ours = proportion(asking.survived, asking.compared)
        success = proportion(figure["survived"], figure["rounds"])
        published = Published(success.value, success.error, program)
        yield Finding("success", f"success, {what}", ours, published, waits)
    if waits is not None:
        time_s = figure["flights"] * FLIGHT_S / waits
        for when, waited in waited_s(run, figure).items():
            ours, theirs = Estimate(waited / time_s, 0.0), Published(waits, waits / 200, program)
            yield Finding("", f"waits {when} (T), {what}", ours, theirs)


def findings(runs: Runs) -> list[Finding]:
    return list(chain.from_iterable(of_figure(FIGURES[name], runs[name]) for name in FIGURES))


LAB = Lab(
    title="swaps and purifications of pairs that wait, as MQNS has them",
    paper="Abane et al., Multiverse: A Simulator for … Entanglement Routing, arXiv:2512.22937",
    runs={name: command_for(figure) for name, figure in FIGURES.items()},
    findings=findings,
    theirs="MQNS",
    charts=(
        Chart("swapped", "two links of F 0.95 swapped", "waits (T)", "F", theirs="MQNS"),
        Chart("purified", "one round on F 0.9", "waits before, after (T)", "F", theirs="MQNS"),
        Chart("success", "one round on F 0.9", "waits before (T)", "success", theirs="MQNS"),
    ),
)
