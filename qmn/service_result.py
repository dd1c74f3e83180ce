"""The facts of a run of a service: result.json for programs, a short table for people."""

import json
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from qmn.result import EXACTNESS, captures, controller_facts
from topologies.record import read_record
from topologies.runtime import EVENT_LOG

NOT_FIGURES = ("event", "peer")


def complete(facts: dict[str, Any], folder: Path) -> None:
    """Add what the run has left in its folder, and write result.json."""
    for end in ("asking", "asked"):
        told = facts.get(end, {})
        facts[end] = {name: value for name, value in told.items() if name not in NOT_FIGURES}
    facts.update(controller_facts(read_record(folder)))
    (folder / "result.json").write_text(json.dumps(facts, indent=2) + "\n")


def show(console: Console, facts: dict[str, Any], folder: Path) -> None:
    """Print the table."""
    table = Table(show_header=False, box=None, padding=(0, 2, 0, 0))
    setup = facts["path_setup_ms"]
    rows = {
        **{name.replace("_", " "): figure(value) for name, value in facts["asking"].items()},
        "metadata to light path": "no path was set up"
        if setup["p50"] is None
        else f"p50 {setup['p50']:.2f} ms, p99 {setup['p99']:.2f} ms, n {setup['n']}",
        "quantum states": f"{facts['backend']}, {EXACTNESS[facts['exact']]}",
        "captures": captures(facts, folder),
        "quantum events": f"{folder}/{EVENT_LOG}" if facts["events"] else "not written",
        "one timeline of both": facts["timeline"],
        "report to look at": facts["report"],
        "all facts": f"{folder}/result.json",
    }
    for name, value in rows.items():
        table.add_row(name, value)
    console.print(table, soft_wrap=True)


def figure(value: Any) -> str:
    """Return a figure as people read it."""
    if value is None:
        return "not known"
    if isinstance(value, float):
        return f"{value:,.4g}" if abs(value) < 10_000 else f"{value:,.0f}"
    return f"{value:,}" if isinstance(value, int) else str(value)
