"""The outcome of a lab: a table for people, and lab.json and findings.csv for programs."""

import csv
import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path

from rich.console import Console
from rich.table import Table

from evidence.labs.lab import Finding, Lab, Published, Run

COLUMNS = (
    *("what", "at", "ours", "error", "error_of_inputs"),
    *("published", "published_error", "published_half_range", "difference", "source", "differs"),
)


def line(finding: Finding) -> dict[str, str | float | None]:
    """Return a finding by column; `difference` is in standard errors."""
    published, difference = finding.published, finding.difference
    return {
        "what": finding.what,
        "at": finding.at,
        "ours": finding.ours.value,
        "error": finding.ours.error,
        "error_of_inputs": finding.inputs,
        "published": published.value if published else None,
        "published_error": published.error if published else None,
        "published_half_range": published.half_range if published else None,
        # JSON has no infinity: what differs although neither has an error.
        "difference": None if difference is None or math.isinf(difference) else difference,
        "source": published.source if published else "",
        "differs": published.differs if published else "",
    }


def write(
    folder: Path, name: str, lab: Lab, runs: Mapping[str, Run], findings: Sequence[Finding]
) -> bool:
    """Write both files; return whether all is within the tolerance."""
    good = all(finding.agrees(lab.tolerance) for finding in findings)
    lines = [{**line(finding), "agrees": finding.agrees(lab.tolerance)} for finding in findings]
    facts = {
        "lab": name,
        "title": lab.title,
        "paper": lab.paper,
        "tolerance": lab.tolerance,
        "agrees": good,
        "runs": {run: f"qmn {lab.runs[run]}" for run in runs},
        "folders": {run: str(each.folder) for run, each in runs.items()},
        "findings": lines,
    }
    (folder / "lab.json").write_text(json.dumps(facts, indent=2) + "\n")
    with (folder / "findings.csv").open("w", newline="") as file:
        table = csv.DictWriter(file, (*COLUMNS, "agrees"))
        table.writeheader()
        table.writerows(lines)
    return good


def show(
    console: Console, findings: Sequence[Finding], tolerance: float, theirs: str = "published"
) -> None:
    """Print what is published, or theory, beside ours, and the difference in standard errors."""
    table = Table(box=None, pad_edge=False)
    for column in ("", "this model", theirs, "std. errors", "where"):
        table.add_column(column, no_wrap=column in ("this model", theirs), overflow="fold")
    for finding in findings:
        if finding.published is not None:
            other = stated(finding.published)
            ours = number(finding.ours.value, finding.error)
            apart = difference(finding, tolerance)
            where = finding.published.source
            if finding.published.differs:
                where += f"; {finding.published.differs}"
            table.add_row(finding.what, ours, other, apart, where)
    console.print(table)


def difference(finding: Finding, tolerance: float) -> str:
    """Return how many standard errors ours is above, and whether that is too many."""
    apart = finding.difference
    if apart is None:
        return ""
    text = f"{apart:+.1f}" if math.isfinite(apart) else "differs"
    if finding.published is not None and finding.published.differs:
        return f"{text} KNOWN"
    return text if finding.agrees(tolerance) else f"{text} TOO FAR"


def stated(published: Published) -> str:
    """Return what a paper states: a number with its error, or a range."""
    if not published.half_range:
        return number(published.value, published.error)
    low, high = (published.value + sign * published.half_range for sign in (-1, 1))
    return f"{low:g} to {high:g}"


def number(value: float, error: float) -> str:
    """Return a number with its error, to the second digit of that."""
    if math.isnan(value) or not error or math.isnan(error):
        return f"{value:g}"
    digits = max(0, 1 - math.floor(math.log10(error)))
    if digits > 6:
        return f"{value:.3g} ± {error:.1g}"
    return f"{value:.{digits}f} ± {error:.{digits}f}"
