"""Measure a grid of parameters, for a table and figures.

On the dispatcher's physical layer alone, or with --emulate in a whole network for each point.
"""

import argparse
import os
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
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
from evidence.networks.catalogue import EMULATED
from qmn.needs import Needs
from qmn.options import add_options, read, titled
from qmn.parser import Parser, listed
from qmn.requests.run_options import LiveOptions
from qmn.results.run_folder import give_tree
from topologies.networks.network import Interrupted, Signals, require_root
from topologies.system.processes.programs import NetworkError
from views.live.beside import page_of_command
from wire.parameters.checks import remedy
from wire.parameters.option import option

MAX_WORKERS = 256
PARTS = ("source", "detectors", "analyser", "memory", "gates")  # whose parameters are so named
EXAMPLES = """
`qmn lab sweep WHAT --help` lists the parameters of WHAT.

values: 0.1   0.1,0.2,0.5   from:to:count (0:0.2:11)   from:to:count:log (1e-3:1:7:log)

examples:
  qmn lab sweep sdc --depolarizing 0:0.2:11
  qmn lab sweep sdc --depolarizing 0.01:0.2:8 --fec none,golay --interleave off,on --pairs 1000000
  qmn lab sweep sdc --emulate --depolarizing 0:0.002:5
  qmn lab sweep teleport --emulate --copper-mbps 0.5:20:8:log --memory-t2-s 0.05
"""


@dataclass(frozen=True, kw_only=True)
class SweepOptions(LiveOptions):
    """The experiment to sweep, and where it is measured."""

    what: str  # an experiment, or a file that names one
    axes: Mapping[str, str]  # values of parameters, by name, as the user says them
    emulate: bool = option(
        False, "a whole network for each point (root; sdc, teleport, and those of `qmn lab demo`)"
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
    parser.usage = "qmn lab sweep WHAT|FILE.toml [--PARAMETER VALUES …] [options]"
    parser.description = __doc__
    parser.epilog = listed("WHAT", names()) + EXAMPLES
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    text = "one of those below, or a file that names one"
    parser.add_argument("what", metavar="WHAT|FILE.toml", help=text)
    parser.add_argument("-h", "--help", action=Help, help="show this; of WHAT, its parameters")
    add_options(parser, SweepOptions)
    for name, helps in _axes().items():
        part = next((f", {each}" for each in PARTS if name.startswith(f"{each}_")), "")
        titled(parser, f"the grid{part}").add_argument(
            f"--{name.replace('_', '-')}", dest=f"axis_{name}", metavar="VALUES", help=helps
        )
    parser.set_defaults(call=call, needs=_needed)


def _needed(arguments: argparse.Namespace) -> Needs:
    return Needs.ROOT if starts_networks(arguments) else Needs.NOTHING


class Help(argparse.Action):
    """Shows the parameters of the experiment that is named before it; of none, which there are."""

    def __init__(self, option_strings: Sequence[str], dest: str, **given: Any) -> None:
        super().__init__(option_strings, dest, nargs=0, default=argparse.SUPPRESS, **given)

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
        parser.print_help()
        parser.exit()


def starts_networks(asked: SweepOptions | argparse.Namespace) -> bool:
    return bool(asked.emulate and not asked.scheduler)


def options_of(arguments: argparse.Namespace) -> SweepOptions:
    given = {name: getattr(arguments, f"axis_{name}") for name in _axes()}
    axes = {name: text for name, text in given.items() if text is not None}
    return read(SweepOptions, arguments, axes=axes)


def call(arguments: argparse.Namespace) -> int:
    return run(options_of(arguments))


def run(options: SweepOptions) -> int:
    """Sweep; turn every fault into one line and an exit status."""
    try:
        grid, seed = grid_of(options)
        with Signals() as signals:
            return sweep(grid, seed, options, signals, Console(highlight=False))
    except (BadGrid, BadTable, SweepError, NetworkError) as error:
        print(f"qmn: {error}", file=sys.stderr)
        return 1
    except Interrupted as error:
        print(f"qmn: {error}; the same command goes on where this one ended", file=sys.stderr)
        return error.status


def grid_of(options: SweepOptions) -> tuple[Grid, int]:
    """Return grid and seed; raise BadGrid before anything is started."""
    content: dict[str, Any] = {"sweep": options.what}
    if options.what.endswith(".toml"):
        content = grids.read(Path(options.what))
    experiment = experiment_of(content["sweep"], options.emulate)
    given = {**content.get("grid", {}), **options.axes}
    seed = content.get("seed", 1) if options.seed is None else options.seed
    if isinstance(seed, bool) or not isinstance(seed, int):
        raise BadGrid(f"seed {seed!r} is not a whole number")
    if options.shown and not starts_networks(options):
        raise BadGrid("--live: networks to look at start here with --emulate, without --scheduler")
    if options.workers is not None and not 1 <= options.workers <= MAX_WORKERS:
        raise BadGrid(f"--workers {options.workers}: choose 1 to {MAX_WORKERS}")
    return grids.build(experiment, given), seed


def experiment_of(name: str, emulate: bool) -> Experiment:
    known = EMULATED if emulate else EXPERIMENTS
    if name not in known:
        where = " with --emulate" if emulate else ""
        raise BadGrid(f"unknown sweep {name!r}{where}: {remedy(name, [*known, 'or a .toml file'])}")
    return known[name]


def sweep(grid: Grid, seed: int, options: SweepOptions, signals: Signals, console: Console) -> int:
    """Measure what is missing, draw, and say how it went."""
    # Dask and matplotlib take a second to load: other verbs do not wait for them.
    from evidence.curves import running
    from evidence.curves.figure import draw
    from evidence.curves.parquet import WITHOUT, write_parquet
    from evidence.curves.pictures import pictures

    if starts_networks(options):
        require_root()
    name = f"{grid.experiment.name}{'-emulated' if options.emulate else ''}"
    with opened(options.out / f"{name}.csv", grid.experiment) as table:
        _tell_beginning(console, grid, seed, table, len(running.missing(grid, seed, table)))
        if running.missing(grid, seed, table):
            with (
                page_of_command(options.live, for_all=options.live_for_all),
                measuring(options, signals.check) as measurer,
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
        draw(picture, file)
        console.print(f"figure   {file}", soft_wrap=True)
    for text in running.disagreements(grid.experiment, rows):
        console.print(f"further from theory than 5 standard errors: {text}", soft_wrap=True)
    give_tree(options.out)
    return 0


@contextmanager
def measuring(options: SweepOptions, check: Callable[[], None]) -> Iterator[Measurer]:
    """Give what measures points: on the physical layer or in networks, here or on a cluster."""
    from evidence.curves import beside, running

    workers, runs = options.workers or os.cpu_count() or 1, options.out / "runs"
    if starts_networks(options):
        yield beside.in_networks(runs, workers, check)
        return
    with running.client(options.scheduler, workers) as client:
        if options.emulate:
            yield running.on_cluster(client, check, partial(beside.measure, str(runs)))
        else:
            yield running.on_cluster(client, check)


def _tell_beginning(console: Console, grid: Grid, seed: int, table: Table, left: int) -> None:
    text = f"{grid.experiment.name}: {grid.size:,} points, seed {seed}"
    if left < grid.size:
        text += f"; {grid.size - left:,} are in {table.path} already"
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
