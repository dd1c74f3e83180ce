"""Published results as runs of the network; without a name it lists them.

Draws our figures beside the published points and prints the difference in standard errors; the
status is 1 if one is beyond the lab's tolerance, or a run has failed. All labs are tried; with
--resume the same command goes on where it ended.
"""

import argparse
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from evidence.curves.lines import BadTable
from evidence.kinds import listing
from evidence.labs import catalogue, runs_done
from evidence.labs.lab import Lab, Run
from evidence.labs.networks import carry_out
from qmn.jobs.run_context import guarded
from qmn.needs import Needs
from qmn.options import BadInput, add_options, read
from qmn.parser import Parser
from qmn.requests.run_options import LiveOptions
from qmn.results.run_folder import give_tree, make_folder, writable
from topologies.networks.network import Interrupted, Signals
from topologies.networks.requirements import require_root
from topologies.system.processes.programs import NetworkError
from views.live.beside import page_of_command
from wire.parameters.option import option

GOES_ON = "the same command with --resume goes on where this one ended"


@dataclass(frozen=True, kw_only=True)
class LabOptions(LiveOptions):
    names: tuple[str, ...] = ()
    all: bool = option(False, "every lab that there is")
    resume: bool = option(False, "do no run again that has gone well in the newest folder of a lab")
    seed: int = option(1, "of all randomness (1)")
    out: Path = option(Path("runs/labs"), "(runs/labs)", metavar="FOLDER")


def names() -> dict[str, str]:
    return {name: catalogue.lab(name).title for name in catalogue.names()}


def describe(parser: Parser) -> None:
    parser.description = __doc__
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument(
        "names",
        nargs="*",
        metavar="NAME",
        help="of a lab, or its folder as ./NAME; none: list them",
    )
    add_options(parser, LabOptions)
    parser.set_defaults(call=call, needs=_needed)


def _needed(arguments: argparse.Namespace) -> Needs:
    return Needs.NETWORK if arguments.names or arguments.all else Needs.NOTHING


def call(arguments: argparse.Namespace) -> int:
    options = read(LabOptions, arguments)
    return guarded(lambda signals, console: do(options, signals, console))


def do(options: LabOptions, signals: Signals, console: Console) -> int:
    if not options.names and not options.all:
        listing.show(names())
        return 0
    if options.names and options.all:
        raise BadInput("--all does every lab: say it, or name some")
    labs = {name: catalogue.lab(name) for name in options.names or catalogue.names()}
    require_root()
    try:
        with page_of_command(options.live, for_all=options.live_for_all):
            outcome = all_done(labs, options, signals, console)
    except Interrupted as error:
        error.add_note(GOES_ON)
        raise
    except BadTable as error:
        raise BadInput(str(error)) from error
    for name, why in outcome.failed.items():
        print(f"qmn: {name} failed: {why}", file=sys.stderr)
    if outcome.far:
        print(f"qmn: beyond its tolerance: {', '.join(outcome.far)}", file=sys.stderr)
    if outcome.failed:
        print(f"qmn: {GOES_ON}", file=sys.stderr)
    return 1 if outcome.failed or outcome.far else 0


@dataclass
class Outcome:
    """The labs that did not end well."""

    failed: dict[str, str] = field(default_factory=dict)  # why, by name
    far: list[str] = field(default_factory=list)


def all_done(
    labs: Mapping[str, Lab], options: LabOptions, signals: Signals, console: Console
) -> Outcome:
    """Do each lab, also behind one that fails."""
    outcome = Outcome()
    folders = {name: begun(name, options) for name in labs}
    missing = {name: runs_missing(lab, folders[name], options.seed) for name, lab in labs.items()}
    left, total = sum(missing.values()), sum(len(lab.runs) for lab in labs.values())
    with Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
        console=console,
    ) as bar:
        task = bar.add_task("runs", total=total, completed=total - left)
        tell = (lambda run: bar.update(task, description=run), lambda: bar.advance(task))
        for number, (name, lab) in enumerate(labs.items(), start=1):
            console.print(
                f"{name}: lab {number} of {len(labs)}, {left} of {total} runs left", soft_wrap=True
            )
            left -= missing[name]
            try:
                good = lab_done(name, lab, folders[name], options, signals, console, tell)
            except (NetworkError, BadTable) as error:
                console.print(f"{name} failed: {error}", soft_wrap=True, markup=False)
                outcome.failed[name] = str(error)
                # Runs that it has not done are not done now.
                bar.update(task, completed=total - left)
                continue
            if not good:
                outcome.far.append(name)
    return outcome


def begun(name: str, options: LabOptions) -> Path | None:
    if not options.resume:
        return None
    return runs_done.newest(options.out, Path(name).name, options.seed)


def runs_missing(lab: Lab, folder: Path | None, seed: int) -> int:
    if folder is None:
        return len(lab.runs)
    with runs_done.opened(folder, lab, seed) as runs:
        return len(runs.missing)


def lab_done(
    name: str,
    lab: Lab,
    folder: Path | None,
    options: LabOptions,
    signals: Signals,
    console: Console,
    tell: tuple[Callable[[str], object], Callable[[], object]],
) -> bool:
    """Do one lab, in a folder that it has begun or a new one; return whether all is within bounds.

    Raise NetworkError if a run fails.
    """
    # Matplotlib takes a second to load: who only wants the list does not wait for it.
    from evidence.labs import drawing, outcome

    name = Path(name).name
    with writable("--out", options.out):
        folder = folder or make_folder(options.out, name)
    try:
        runs = all_runs(name, lab, folder, options.seed, signals.check, tell)
        findings = lab.findings(runs)
        good = outcome.write(folder, name, lab, runs, findings)
        files = [*drawing.draw_charts(lab.charts, findings, folder), *lab.files(runs, folder)]
    finally:
        give_tree(options.out)
    console.print(f"\n{name}: {lab.title}\n{lab.paper}", soft_wrap=True, markup=False)
    outcome.show(console, findings, lab.tolerance, lab.theirs)
    for file in files:
        console.print(f"file    {file}", soft_wrap=True, markup=False)
    console.print(f"facts   {folder / 'lab.json'}", soft_wrap=True, markup=False)
    within = "within" if good else "NOT within"
    console.print(f"{within} {lab.tolerance:g} standard errors", markup=False)
    return good


def all_runs(
    name: str,
    lab: Lab,
    folder: Path,
    seed: int,
    check: Callable[[], None],
    tell: Sequence[Callable[..., object]],
) -> dict[str, Run]:
    begins, ended = tell
    runs: dict[str, Run] = {}
    with runs_done.opened(folder, lab, seed) as done:
        for run, command in lab.runs.items():
            before = done.get(run)
            if before is None:
                begins(f"{name}: {run}")
                before = carry_out(run, command, seed, folder, check)
                done.add(run, before)
                ended()
            runs[run] = before
    return runs
