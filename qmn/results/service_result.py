"""The facts of a run of a service: result.json for programs, a short table for people."""

import json
from pathlib import Path
from typing import Any

from rich.console import Console

from qmn.results.result import controller_facts, emulation, print_rows, rows_of_every_run
from wire.controller_record import read_record

NOT_FIGURES = ("event", "peer")


def complete(facts: dict[str, Any], folder: Path) -> None:
    """Add what the run has left in its folder, and write result.json."""
    for end in ("asking", "asked"):
        told = facts.get(end, {})
        facts[end] = {name: value for name, value in told.items() if name not in NOT_FIGURES}
    facts["emulation"] = emulation(facts["asking"], facts)
    facts.update(controller_facts(read_record(folder)))
    (folder / "result.json").write_text(json.dumps(facts, indent=2) + "\n")


def show(console: Console, facts: dict[str, Any], folder: Path) -> None:
    """Print the table."""
    told = {name.replace("_", " "): figure(value) for name, value in facts["asking"].items()}
    eve = {f"eve: {name.replace('_', ' ')}": figure(v) for name, v in facts.get("eve", {}).items()}
    print_rows(console, {**told, **eve, **rows_of_every_run(facts, folder)})


def figure(value: Any) -> str:
    """Return a figure as people read it."""
    if value is None:
        return "not known"
    if isinstance(value, float):
        return f"{value:,.4g}" if abs(value) < 10_000 else f"{value:,.0f}"
    return f"{value:,}" if isinstance(value, int) else str(value)
