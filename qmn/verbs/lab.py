"""qmn lab [NAME …]: published results as runs of the network; without a name it lists them.

Draws our figures beside the published points and prints the difference in standard errors; the
status is 1 if one is beyond the lab's tolerance.
"""

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from qmn.jobs.run_context import guarded
from qmn.labs import catalogue
from qmn.labs.lab import Lab, Run
from qmn.labs.networks import carry_out
from qmn.options import BadInput, add_options, read
from qmn.results.run_folder import give_tree, make_folder
from topologies.network import Signals, require_root
from wire.parameters.option import option


@dataclass(frozen=True, kw_only=True)
class LabOptions:
    """Which labs, and where what they leave goes."""

    names: tuple[str, ...] = ()
    all: bool = option(False, "every lab that there is")
    seed: int = option(1, "of all randomness (1)")
    out: Path = option(Path("runs/labs"), "(runs/labs)", metavar="FOLDER")


def add_parser(verbs: Any) -> None:
    """Describe the verb."""
    parser = verbs.add_parser(
        "lab",
        help="published results as runs of the network",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "names",
        nargs="*",
        metavar="NAME",
        help="of a lab, or its folder as ./NAME; none: list them",
    )
    add_options(parser, LabOptions)
    parser.set_defaults(call=call, needs_root=lambda arguments: arguments.names or arguments.all)


def call(arguments: argparse.Namespace) -> int:
    """List the labs, or do some."""
    options = read(LabOptions, arguments)
    return guarded(lambda signals, console: do(options, signals, console))


def do(options: LabOptions, signals: Signals, console: Console) -> int:
    """Do the labs asked for, and return 1 if one is beyond its tolerance."""
    if not options.names and not options.all:
        for name in catalogue.names():
            console.print(f"{name:<12} {catalogue.lab(name).title}", soft_wrap=True)
        return 0
    if options.names and options.all:
        raise BadInput("--all does every lab: say it, or name some")
    labs = {name: catalogue.lab(name) for name in options.names or catalogue.names()}
    require_root()
    with Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
        console=console,
    ) as bar:
        task = bar.add_task("runs", total=sum(len(lab.runs) for lab in labs.values()))

        def begun(name: str) -> None:
            bar.update(task, description=name)

        done = [
            lab_done(name, lab, options, signals, console, (begun, lambda: bar.advance(task)))
            for name, lab in labs.items()
        ]
    return 0 if all(done) else 1


def lab_done(
    name: str,
    lab: Lab,
    options: LabOptions,
    signals: Signals,
    console: Console,
    tell: Sequence[Any],
) -> bool:
    """Do one lab, and return whether all is within its tolerance."""
    # Matplotlib takes a second to load: who only wants the list does not wait for it.
    from qmn.labs import drawing, outcome

    begun, ended = tell
    name = Path(name).name
    folder = make_folder(options.out, name)
    runs: dict[str, Run] = {}
    try:
        for run, said in lab.runs.items():
            begun(f"{name}: {run}")
            runs[run] = carry_out(run, said, options.seed, folder, signals.check)
            ended()
        findings = lab.findings(runs)
        good = outcome.write(folder, name, lab, runs, findings)
        files = [*drawing.draw_charts(lab.charts, findings, folder), *lab.files(runs, folder)]
    finally:
        give_tree(options.out)
    console.print(f"\n{name}: {lab.title}\n{lab.paper}", soft_wrap=True, markup=False)
    outcome.show(console, lab, findings)
    for file in files:
        console.print(f"file    {file}", soft_wrap=True, markup=False)
    console.print(f"facts   {folder / 'lab.json'}", soft_wrap=True, markup=False)
    within = "within" if good else "NOT within"
    console.print(f"{within} {lab.tolerance:g} standard errors", markup=False)
    return good
