"""Measure a grid of parameters, for a table and figures.

Of an experiment on the dispatcher's physical layer alone, or of a job over the network: axes are
any option of `qmn run JOB`, and settings of its parts (node.memory.t2_s is of every host).
"""

import argparse
import os
import sys
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    ProgressColumn,
    TextColumn,
    TimeRemainingColumn,
)

from evidence.curves import grid as grids
from evidence.curves.catalogue import EXPERIMENTS
from evidence.curves.experiment import Experiment, SweepError
from evidence.curves.grid import Grid, Measurer
from evidence.curves.lines import BadTable
from evidence.curves.parameters import BadGrid
from evidence.curves.table import Table, opened
from evidence.networks import job_sweep
from evidence.networks.catalogue import EMULATED
from evidence.networks.job_sweep import WHAT
from qmn.needs import Needs
from qmn.options import add_options, read, titled
from qmn.parser import Parser, listed
from qmn.printable_text import console_of_output
from qmn.requests.run_options import LiveOptions
from qmn.results.run_folder import give_tree
from topologies.networks.network import Interrupted, Signals
from topologies.networks.requirements import require_root
from topologies.system.processes.programs import NetworkError
from views.live.beside import page_of_command
from wire.parameters.checks import remedy
from wire.parameters.option import option

MAX_WORKERS = 256
PARTS = ("source", "detectors", "analyser", "memory", "gates")  # whose parameters are so named
EXAMPLES = """
`qmn lab sweep WHAT --help` lists the parameters of WHAT, `qmn run JOB --help` the options of JOB.
A JOB that is also an experiment is swept over the network if an axis is none of the experiment's,
or with --emulate.

values: 0.1   0.1,0.2,0.5   1:8 (whole numbers)   0:0.2:11 (from:to:count)   1e-3:1:7:log

examples:
  qmn lab sweep sdc --depolarizing 0:0.2:11
  qmn lab sweep sdc --depolarizing 0.01:0.2:8 --fec none,golay --interleave off,on --pairs 1000000
  qmn lab sweep swap --switches 1:8 --node.memory.t2_s 0.01,0.1,1
  qmn lab sweep qkd --eve 0:0.3:7 --count 10000
  qmn lab sweep teleport --emulate --copper-mbps 0.5:20:8:log --node.memory.t2_s 50ms
"""


@dataclass(frozen=True, kw_only=True)
class SweepOptions(LiveOptions):
    what: str  # an experiment, or a file that names one
    axes: Mapping[str, str]  # values of parameters, by name, as the user says them
    emulate: bool = option(
        False, "over networks (needs root; jobs, and experiments of `qmn lab demo`)"
    )
    seed: int | None = option(None, "of all randomness (1)")
    out: Path = option(Path("sweeps"), "(sweeps)", metavar="FOLDER")
    workers: int | None = option(
        None, "processes, or networks, at a time (processors)", metavar="N"
    )
    scheduler: str = option("", "a Dask cluster instead of processes", metavar="tcp://…")


def names() -> dict[str, str]:
    return {each.name: each.what for each in EXPERIMENTS.values()}


def describe(parser: Parser) -> None:
    parser.usage = "qmn lab sweep WHAT|JOB|FILE.toml [--PARAMETER VALUES …] [options]"
    parser.description = __doc__
    parser.epilog = listed("WHAT", names()) + "\n" + listed("JOB", WHAT) + EXAMPLES
    parser.take_unknown = take_axes
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    text = "one of those below, or a file that names one"
    parser.add_argument("what", metavar="WHAT|JOB|FILE.toml", help=text)
    parser.add_argument("-h", "--help", action=Help, help="show this; of WHAT, its parameters")
    add_options(parser, SweepOptions)
    for name, helps in _axes().items():
        part = next((f", {each}" for each in PARTS if name.startswith(f"{each}_")), "")
        titled(parser, f"the grid{part}").add_argument(
            f"--{name.replace('_', '-')}", dest=f"axis_{name}", metavar="VALUES", help=helps
        )
    parser.set_defaults(call=call, needs=_needed, further={})


def take_axes(arguments: argparse.Namespace, words: Sequence[str]) -> None:
    """Take options that no experiment has as axes of a job; raise ValueError for what is none."""
    further, left = {}, list(words)
    while left:
        flag, equals, text = left.pop(0).partition("=")
        if not flag.startswith("--"):
            raise ValueError(f"unexpected argument {flag!r}")
        if not equals and not (left and not left[0].startswith("--")):
            raise ValueError(f"{flag} has no value: write {flag} VALUES")
        further[axis_name(flag)] = text if equals else left.pop(0)
    arguments.further = further


def axis_name(flag: str) -> str:
    """Return the name of an axis; settings of parts have hyphens between two nodes."""
    name = flag.removeprefix("--")
    return name if "." in name else name.replace("-", "_")


def _needed(arguments: argparse.Namespace) -> Needs:
    with suppress(BadGrid):  # which is refused without root
        return Needs.ROOT if starts_networks(arguments) else Needs.NOTHING
    return Needs.NOTHING


class Help(argparse.Action):
    """Shows the parameters of the experiment that is named before it; of none, which there are."""

    def __init__(self, option_strings: Sequence[str], dest: str, **keywords: Any) -> None:
        super().__init__(option_strings, dest, nargs=0, default=argparse.SUPPRESS, **keywords)

    def __call__(self, parser: Any, namespace: Any, *_words: object) -> None:
        named = str(getattr(namespace, "what", None))
        light, emulated = EXPERIMENTS.get(named), EMULATED.get(named)
        for action in parser._actions:
            name = action.dest.removeprefix("axis_")
            if action.dest == "what" and (light or emulated):
                parameters = {each.what for each in (light, emulated) if each}
                action.help = f"{named}: {', or '.join(sorted(parameters))}"
                parser.epilog = EXAMPLES
            elif name == action.dest or (light and name in light.names):
                continue
            elif emulated and name in emulated.names:
                action.help += ", with --emulate" if light else ""
            else:
                action.help = argparse.SUPPRESS
        print(parser.whole_help(), end="")
        parser.exit()


def starts_networks(options: SweepOptions | argparse.Namespace) -> bool:
    axes = options.axes if isinstance(options, SweepOptions) else _axes_of(options)
    content = content_of(options.what)
    axes = {**content.get("grid", {}), **axes}
    return is_over_networks(content["sweep"], options.emulate, axes) and not options.scheduler


def content_of(what: str) -> dict[str, Any]:
    """Return what a TOML file says, or the name alone; raise BadGrid."""
    return grids.read(Path(what)) if what.endswith(".toml") else {"sweep": what}


def is_over_networks(what: str, emulate: bool, axes: Collection[str]) -> bool:
    """Return whether a network measures: it alone knows the job, or an axis."""
    if emulate or what not in EXPERIMENTS:
        return emulate or what in WHAT
    return what in WHAT and not set(EXPERIMENTS[what].names).issuperset(axes)


def _axes_of(arguments: argparse.Namespace) -> dict[str, str]:
    axes = {name: getattr(arguments, f"axis_{name}") for name in _axes()}
    chosen = {name: text for name, text in axes.items() if text is not None}
    return {**chosen, **arguments.further}


def options_of(arguments: argparse.Namespace) -> SweepOptions:
    return read(SweepOptions, arguments, axes=_axes_of(arguments))


def call(arguments: argparse.Namespace) -> int:
    return run(options_of(arguments))


def run(options: SweepOptions) -> int:
    """Sweep; turn every fault into one line and an exit status."""
    try:
        grid, seed = grid_of(options)
        with Signals() as signals:
            return sweep(grid, seed, options, signals, console_of_output())
    except (BadGrid, BadTable, SweepError, NetworkError) as error:
        print(f"qmn: {error}", file=sys.stderr)
        return 1
    except Interrupted as error:
        print(f"qmn: {error}; the same command goes on where this one ended", file=sys.stderr)
        return error.status


def grid_of(options: SweepOptions) -> tuple[Grid, int]:
    """Return grid and seed; raise BadGrid before anything is started."""
    content = content_of(options.what)
    axes = {**content.get("grid", {}), **options.axes}
    seed = content.get("seed", 1) if options.seed is None else options.seed
    if isinstance(seed, bool) or not isinstance(seed, int):
        raise BadGrid(f"seed {seed!r} is not a whole number")
    if options.workers is not None and not 1 <= options.workers <= MAX_WORKERS:
        raise BadGrid(f"--workers {options.workers}: choose 1 to {MAX_WORKERS}")
    networks = is_over_networks(content["sweep"], options.emulate, axes)
    if options.shown and not (networks and not options.scheduler):
        raise BadGrid("--live: networks to look at start here with --emulate, without --scheduler")
    if networks and content["sweep"] in WHAT:
        return job_sweep.grid_of(content["sweep"], axes), seed
    return grids.build(experiment_of(content["sweep"], options.emulate), axes), seed


def experiment_of(name: str, emulate: bool) -> Experiment:
    experiments = EMULATED if emulate else EXPERIMENTS
    if name not in experiments:
        where = " with --emulate" if emulate else ""
        names = dict.fromkeys([*experiments, *WHAT, "or a .toml file"])
        raise BadGrid(f"unknown sweep {name!r}{where}: {remedy(name, names)}")
    return experiments[name]


def sweep(grid: Grid, seed: int, options: SweepOptions, signals: Signals, console: Console) -> int:
    """Measure what is missing, draw, and say how it went."""
    # Dask and matplotlib take a second to load: other verbs do not wait for them.
    from evidence.curves import running
    from evidence.curves.figure import draw
    from evidence.curves.parquet import WITHOUT, write_parquet
    from evidence.curves.pictures import pictures

    if starts_networks(options):
        require_root()
    name = f"{grid.experiment.file}{'-emulated' if grid.experiment.name in EMULATED else ''}"
    with opened(options.out / f"{name}.csv", grid.experiment) as table:
        left = len(running.missing(grid, seed, table))
        _tell_beginning(console, grid, seed, table, left, options.scheduler)
        if left:
            with (
                page_of_command(options.live, for_all=options.live_for_all),
                measuring(grid.experiment, options, signals.check) as measurer,
            ):
                _follow(console, grid, seed, table, measurer)
        rows = running.rows(grid, seed, table)
    others = len(table) - len(rows)
    beside = f", with {others:,} points of other grids or seeds (--out: apart)" if others else ""
    console.print(f"table    {table.path}{beside}", soft_wrap=True)
    parquet = write_parquet(table.path)
    console.print(f"table    {parquet}" if parquet else WITHOUT, soft_wrap=True)
    for picture in pictures(grid, rows):
        file = options.out / f"{name}-{picture.measure.name}.png"
        draw(picture, file, file.with_suffix(".pdf"))
        console.print(f"figure   {file}, and .pdf", soft_wrap=True)
    for text in running.disagreements(grid.experiment, rows):
        console.print(f"further from theory than 5 standard errors: {text}", soft_wrap=True)
    give_tree(options.out)
    return 0


@contextmanager
def measuring(
    experiment: Experiment, options: SweepOptions, check: Callable[[], None]
) -> Iterator[Measurer]:
    """Give what measures points: on the physical layer or in networks, here or on a cluster."""
    from evidence.curves import beside, running

    workers, runs = options.workers or os.cpu_count() or 1, options.out / "runs"
    if starts_networks(options):
        yield beside.in_networks(runs, workers, check)
        return
    with running.client(options.scheduler, workers) as client:
        if options.emulate or isinstance(experiment, job_sweep.JobSweep):
            yield running.on_cluster(client, check, partial(beside.measure, str(runs)))
        else:
            yield running.on_cluster(client, check)


def _tell_beginning(
    console: Console, grid: Grid, seed: int, table: Table, left: int, scheduler: str | None
) -> None:
    text = f"{grid.experiment.name}: {grid.size:,} points, seed {seed}"
    if left < grid.size:
        text += f"; {grid.size - left:,} are in {table.path} already"
    elif isinstance(grid.experiment, job_sweep.JobSweep) and not scheduler:
        text += f", {job_sweep.networks_of(grid)}"
    console.print(text, soft_wrap=True)
    if table.cut_off:
        console.print(
            f"{table.path}: its last line was half written; that point comes again", soft_wrap=True
        )


def _follow(console: Console, grid: Grid, seed: int, table: Table, measurer: Measurer) -> None:
    from evidence.curves import running

    with Progress(*progress_columns(), console=console) as bar:
        left = len(running.missing(grid, seed, table))
        task = bar.add_task("points", total=grid.size, completed=grid.size - left)
        for _row in running.fill(grid, seed, table, measurer):
            bar.advance(task)


def progress_columns() -> Sequence[ProgressColumn]:
    return TextColumn("points"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn()


def _axes() -> dict[str, str]:
    helps: dict[str, str] = {}
    for experiment in (*EXPERIMENTS.values(), *EMULATED.values()):
        for each in experiment.parameters:
            default = f" ({each.default:g})" if isinstance(each.default, float) else ""
            helps.setdefault(each.name, f"{each.range}{default or f' ({each.default})'}")
    return helps
