"""The result of heavy traffic: what became of all sessions, and how much each fibre was used."""

import json
from pathlib import Path
from typing import Any

from rich.console import Console

from qmn.live.event_sources import recorded
from qmn.results.network_facts import NetworkFacts
from qmn.results.result import emulation, note_controller, print_rows, rows_of_every_run
from qmn.results.schema import RunFacts
from qmn.results.service_result import number_text
from qmn.traffic.fiber_use import fiber_use, shares, span_of
from topologies.system.runs.runtime import EVENT_CAPTURE
from wire.controller_lines import read_record

BUSIEST = 3  # fibres that the table names


def complete(facts: RunFacts, folder: Path) -> None:
    """Add the use of every fibre, and what a person is told first; write result.json."""
    load = facts.setdefault("load", {})
    capture = folder / EVENT_CAPTURE
    if "network" in facts and capture.exists():
        events = (event for event in recorded(capture, follow=False) if not event.photon)
        use = fiber_use(NetworkFacts.from_dict(facts["network"]), events)
        load["fibers"] = shares(use, *span_of(use))
    facts["asking"], facts["asked"] = summary(load), {}
    facts["emulation"] = emulation({}, facts)
    note_controller(facts, read_record(folder))
    (folder / "result.json").write_text(json.dumps(facts, indent=2) + "\n")


def summary(load: dict[str, Any]) -> dict[str, Any]:
    """Return the numbers that a person is told first."""
    if "offered" not in load:
        return {}
    blocked, broken = sum(load["blocked"].values()), sum(load["broken"].values())
    return {
        "sessions": load["offered"],
        "accepted": load["accepted"],
        "queued": load["queued"],
        "blocked": blocked,
        "late": load["late"],
        "broken": broken,
        "offered_per_s": load["offered_per_s"],
        "most_at_a_time": load["at_a_time"],
        "carried_erlang": load["carried"],
        "setup_p50_s": load["setup_s"]["p50"],
        "setup_p99_s": load["setup_s"]["p99"],
        "pairs_per_s": load["pairs_per_s"],
        "fairness": load["fairness"],
        "controller_ms_a_session": load["controller_ms"],
    }


def show(console: Console, facts: RunFacts, folder: Path) -> None:
    """Print the table."""
    load = facts["load"]
    rows = {name.replace("_", " "): number_text(value) for name, value in facts["asking"].items()}
    for kind in ("blocked", "broken"):
        rows |= {f"{kind}: {reason}": number_text(count) for reason, count in load[kind].items()}
    for each in load["fidelity_by_age"]:
        rows[f"fidelity after {each['age_s']:.3g} s"] = (
            f"{each['fidelity']:.4f} ± {each['standard_error']:.4f}"
        )
    used = sorted(load.get("fibers", {}).items(), key=lambda item: -item[1])
    rows |= {f"use of {name}": f"{share:.1%}" for name, share in used[:BUSIEST]}
    print_rows(console, {**rows, **rows_of_every_run(facts, folder)})
