"""Measure the physical layer against theory and published figures, and draw it.

Fails, and names the point, if one is further from theory, or from what is published, than 5
standard errors. Prints of each figure the point that is furthest from theory, and a row for each
published figure: ours, theirs, the difference in standard errors, paper and table.
"""

import argparse
import math
import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console
from rich.progress import Progress

from evidence.curves.estimates import SIGMAS
from evidence.curves.experiment import SweepError
from evidence.curves.grid import Measurer, Row
from evidence.curves.lines import BadTable
from evidence.curves.parameters import BadGrid
from evidence.curves.table import opened
from evidence.kinds.sweep import MAX_WORKERS, progress_columns
from evidence.labs.lab import Finding, Published, PublishedRow
from evidence.labs.outcome import number, show, stated
from qmn.options import add_options, read
from qmn.parser import Parser
from qmn.printable_text import console_of_output
from qmn.results.run_folder import give_tree
from topologies.networks.network import Interrupted, Signals
from wire.parameters.checks import remedy
from wire.parameters.option import option

if TYPE_CHECKING:
    from evidence.curves.sheets import Sheet


PUBLISHED = "published"  # as a sheet's name: what papers state


@dataclass(frozen=True)
class CurvesOptions:
    out: Path = option(Path("curves"), "(curves)", metavar="FOLDER")
    seed: int = option(1, "of all randomness (1)")
    workers: int | None = option(None, "processes (as many as processors)", metavar="N")
    scheduler: str = option("", "a Dask cluster instead of processes", metavar="tcp://…")
    only: tuple[str, ...] = option(
        (), f"one sheet alone, or {PUBLISHED} (more than once)", metavar="NAME"
    )


def names() -> dict[str, str]:
    from evidence.curves.sheets import SHEETS

    return {sheet.name: sheet.curves[0].title for sheet in SHEETS}


def describe(parser: Parser) -> None:
    parser.description = __doc__
    add_options(parser, CurvesOptions)
    parser.set_defaults(call=call)


def call(arguments: argparse.Namespace) -> int:
    """Measure and draw everything; turn every fault into one line and an exit status."""
    # Dask and matplotlib take a second to load: other kinds do not wait for them.
    from evidence.curves import running

    console, options = console_of_output(), read(CurvesOptions, arguments)
    try:
        sheets, rows = chosen(options)
        workers = options.workers or os.cpu_count() or 1
        with Signals() as signals, running.client(options.scheduler, workers) as client:
            measurer = running.on_cluster(client, signals.check)
            far = measure(sheets, options.out, options.seed, measurer, console)
            far += compare(rows, options.seed, measurer, console)
    except (BadGrid, BadTable, SweepError) as error:
        print(f"qmn: {error}", file=sys.stderr)
        return 1
    except Interrupted as error:
        print(f"qmn: {error}", file=sys.stderr)
        return error.status
    for text in far:
        print(f"qmn: more than 5 standard errors away: {text}", file=sys.stderr)
    return 1 if far else 0


def chosen(options: CurvesOptions) -> "tuple[list[Sheet], list[PublishedRow]]":
    """Return the sheets and published figures asked for; raise BadGrid for what cannot be."""
    from evidence.curves.sheets import SHEETS
    from evidence.labs import rows as published

    if options.workers is not None and not 1 <= options.workers <= MAX_WORKERS:
        raise BadGrid(f"--workers {options.workers}: choose 1 to {MAX_WORKERS}")
    names = {sheet.name: sheet for sheet in SHEETS}
    choices = [*names, PUBLISHED]
    for name in options.only:
        if name not in choices:
            raise BadGrid(f"--only {name}: {remedy(name, choices)}")
    chosen_names = options.only or choices
    sheets = [names[name] for name in chosen_names if name in names]
    return sheets, published.rows() if PUBLISHED in chosen_names else []


def measure(
    sheets: "Sequence[Sheet]", out: Path, seed: int, measurer: Measurer, console: Console
) -> list[str]:
    """Measure and draw the sheets; return every point that is too far from theory."""
    from evidence.curves import running
    from evidence.curves.figure import draw

    if not sheets:
        return []
    far, points, findings = [], 0, list[Finding]()
    with Progress(*progress_columns(), console=console) as bar:
        task = bar.add_task("points", total=sum(sheet.grid.size for sheet in sheets))
        for sheet in sheets:
            grid = sheet.grid
            file = out / f"{sheet.name}.csv"
            file.unlink(missing_ok=True)  # it shall be the code of today that is checked
            with opened(file, grid.experiment) as table:
                for _row in running.fill(grid, seed, table, measurer):
                    bar.advance(task)
                rows = running.rows(grid, seed, table)
            far += running.disagreements(grid.experiment, rows) + sheet.unmeasured(rows)
            points += len(rows)
            findings += furthest(sheet, rows)
            for curve in sheet.curves:
                draw(sheet.picture(curve, rows), out / f"{curve.file}.png")
    give_tree(out)
    show(console, findings, SIGMAS, "theory")
    console.print(f"{points} points in {out}/, {len(far)} too far from theory", soft_wrap=True)
    return far


def compare(
    rows: Sequence[PublishedRow], seed: int, measurer: Measurer, console: Console
) -> list[str]:
    """Print our figure beside each published one; return every one that is too far from it."""
    from evidence.labs import rows as published

    if not rows:
        return []
    findings: Sequence[Finding] = ()
    with Progress(*progress_columns(), console=console) as bar:
        task = bar.add_task("published", total=sum(map(len, published.points(rows).values())))
        for findings in published.measured(rows, seed, measurer):
            bar.advance(task, 0 if findings else 1)
    show(console, findings, SIGMAS)
    far = [finding for finding in findings if not finding.agrees(SIGMAS)]
    explained = sum(
        finding.published is not None and bool(finding.published.differs) for finding in findings
    )
    counts = f"{len(far)} too far from ours, {explained} known to differ"
    console.print(f"{len(rows)} published figures, {counts}", soft_wrap=True)
    return [finding_text(each) for each in far]


def finding_text(finding: Finding) -> str:
    assert finding.published is not None
    ours = number(finding.ours.value, finding.error)
    theirs = stated(finding.published)
    return f"{finding.what}: {ours}, published {theirs} ({finding.published.source})"


def furthest(sheet: "Sheet", rows: Sequence[Row]) -> list[Finding]:
    """Return of each figure the point that is furthest from theory, of those that were counted."""
    experiment, findings = sheet.grid.experiment, list[Finding]()
    for curve in sheet.curves:
        measure, compared = experiment.measure(curve.measure), list[Finding]()
        for values, outcome in rows:
            theory, ours = measure.expected(values, outcome), outcome[measure.name]
            if theory is not None and ours.error > 0 and not math.isnan(ours.value):
                there = Published(theory, 0.0, experiment.place(values))
                compared.append(Finding("", curve.title, ours, there))
        findings += (
            [max(compared, key=lambda each: abs(each.difference or 0.0))] if compared else []
        )
    return findings
