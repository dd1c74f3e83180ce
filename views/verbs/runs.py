"""qmn runs: list runs, compare two, remove old ones, give one away.

qmn runs                        list them, the newest last
qmn runs compare RUN RUN        parameters that differ, figures, and when what happened first
qmn runs prune --older-than 30d remove old ones; --keep-gb 5: the oldest until the rest has room
qmn runs export RUN FILE.zip    one file without what is secret in it
qmn runs export RUN FOLDER      the same as a new folder
qmn runs import FILE.zip        make a run of such a file

A run's folder can be read by its owner alone. Captures and event logs show the state of every
qubit: if a run may have made keys, they give the keys away, and an export leaves them out.
Everything else is exported, readable by all. Keys that a run keeps are never in its folder.
"""

import argparse
import re
import shutil
import sys
import time
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from qmn.running.controller_console import wide_console
from qmn.running.network import announced_folders
from qmn.running.tables import counted, table
from views.archive import comparison as run_comparison
from views.archive.archive import BadArchive, exported, imported
from views.archive.index import BEGAN, Run, runs_in
from views.archive.named_run import RUNS, UnknownRun, find_run
from views.archive.shared_copy import CannotShare, share
from wire.malformed import MalformedPacket

UNITS_S = {"h": 3600, "d": 86_400, "w": 604_800}
LIST_WIDTH = 120  # in a file or a pipe: what is longer goes on below
FRESH_S = 600  # a folder without a result that has changed so lately may be of a run that goes on


class BadRequest(Exception):
    """Something that cannot be done with these runs; the text names value and remedy."""


def add_parser(verbs: Any) -> None:
    parser = verbs.add_parser(
        "runs",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    folder = {"type": Path, "default": RUNS, "metavar": "DIR", "help": "of runs (runs)"}
    parser.add_argument("--runs", **folder)
    parser.add_argument("--json", action="store_true", help="the list for programs")
    parser.set_defaults(call=call, act=show)
    acts = parser.add_subparsers(metavar="ACT")
    comparing = acts.add_parser("compare", help="two runs side by side")
    for name in ("one", "two"):
        comparing.add_argument(
            name, metavar="RUN", help="its name, a part of it, or its folder, as latest"
        )
    comparing.set_defaults(act=compare)
    pruning = acts.add_parser("prune", help="remove old runs")
    add = pruning.add_argument
    add("--older-than", type=age_s, metavar="AGE", help="12h, 30d, 8w")
    add("--keep-gb", type=float, metavar="GB", help="remove the oldest until the rest has so much")
    add("--dry-run", action="store_true", help="say what would go, and remove nothing")
    pruning.set_defaults(act=prune)
    exporting = acts.add_parser("export", help="a run as one file, or a folder, to give away")
    exporting.add_argument(
        "run", metavar="RUN", help="its name, a part of it, or its folder, as latest"
    )
    text = "a file, if it ends in .zip, or else a folder; neither exists yet"
    exporting.add_argument("copy", type=Path, metavar="FILE.zip|FOLDER", help=text)
    text = "a file with what is secret in it, readable by you alone"
    exporting.add_argument("--whole", action="store_true", help=text)
    exporting.set_defaults(act=export)
    importing = acts.add_parser("import", help="a run of such a file")
    importing.add_argument("file", type=Path, metavar="FILE.zip", help="of `export`")
    importing.set_defaults(act=take)


def age_s(text: str) -> float:
    """Return an age in seconds; raise ArgumentTypeError for anything else."""
    match = re.fullmatch(r"(\d+(?:\.\d+)?)([hdw])", text)
    if not match:
        raise argparse.ArgumentTypeError(f"{text!r} is not an age such as 12h, 30d or 8w")
    return float(match[1]) * UNITS_S[match[2]]


def call(arguments: argparse.Namespace) -> int:
    """Do what is asked; turn what is wrong into one line and an exit status."""
    try:
        arguments.act(arguments)
    except (BadRequest, BadArchive, CannotShare, MalformedPacket, UnknownRun) as error:
        print(f"qmn: {error}", file=sys.stderr)
        return 1
    except OSError as error:
        print(f"qmn: {error.filename}: {error.strerror}", file=sys.stderr)
        return 1
    return 0


def show(arguments: argparse.Namespace) -> None:
    runs = all_runs(arguments.runs)
    if arguments.json:
        import json

        rows = [{**asdict(run), "changed": run.parameters} for run in runs]
        print(json.dumps(rows, indent=2))
        return
    lines = [
        [
            *(run.name, in_short(run.began), run.what),
            *(parameter_text(run.parameters), run.outcome, megabytes(run.bytes)),
        ]
        for run in runs
    ]
    columns = ("run", "began", "what", "not the default", "outcome", "MB")
    size = megabytes(sum(run.bytes for run in runs))
    title = f"{counted(len(runs), 'run')} in {arguments.runs}, {size} MB"
    wide_console(LIST_WIDTH).print(table(title, columns, lines))


def all_runs(folder: Path) -> list[Run]:
    """Return the runs of a folder; raise BadRequest if there is none."""
    if not folder.is_dir():
        raise BadRequest(
            f"no runs yet: {folder} does not exist; make a run with `qmn run sdc`, or name "
            "another folder with --runs"
        )
    return runs_in(folder)


def in_short(began: str) -> str:
    """Return when a run began, as 26 Nov 15:06: its name has the rest."""
    return time.strftime("%d %b %H:%M", time.strptime(began, BEGAN))


def parameter_text(parameters: dict[str, Any]) -> str:
    return ", ".join(
        f"{name} {' '.join(map(str, value)) if isinstance(value, list) else value}"
        for name, value in parameters.items()
    )


def megabytes(count: int) -> str:
    return f"{count / 1e6:,.1f}"


def compare(arguments: argparse.Namespace) -> None:
    one, two = (find(arguments.runs, name) for name in (arguments.one, arguments.two))
    columns = ("", one.name, two.name)
    console = wide_console()
    for title, rows in (
        ("parameters that differ", run_comparison.parameters(one, two)),
        ("figures", run_comparison.figures(one, two)),
        ("first time of each (ms)", run_comparison.moments(one, two)),
    ):
        console.print(table(title if rows else f"{title}: none", columns, [list(r) for r in rows]))


def find(runs: Path, name: str) -> Path:
    """Return the folder of a run that has ended, by its name or path; raise UnknownRun."""
    path = find_run(name, runs)
    if (path / "result.json").is_file():
        return path.resolve()
    raise UnknownRun(f"{name}: no result of a run that has ended; `qmn runs` lists them")


def prune(arguments: argparse.Namespace) -> None:
    """Remove runs that are too old or too many."""
    if arguments.older_than is None and arguments.keep_gb is None:
        raise BadRequest("prune which runs? Say --older-than 30d, or --keep-gb 5")
    runs = [run for run in all_runs(arguments.runs) if not goes_on(arguments.runs / run.name, run)]
    doomed = to_prune(runs, arguments.older_than, arguments.keep_gb, time.time())
    for run in doomed:
        if not arguments.dry_run:
            shutil.rmtree(arguments.runs / run.name)
        print(f"{'would remove' if arguments.dry_run else 'removed'} {run.name}")
    latest = arguments.runs / "latest"
    if latest.is_symlink() and not latest.exists():
        latest.unlink()
    print(f"{counted(len(doomed), 'run')}, {megabytes(sum(run.bytes for run in doomed))} MB")


def to_prune(
    runs: Sequence[Run], older_than_s: float | None, keep_gb: float | None, now: float
) -> list[Run]:
    began = {run: time.mktime(time.strptime(run.began, BEGAN)) for run in runs}
    left, doomed = sum(run.bytes for run in runs), []
    for run in runs:
        old = older_than_s is not None and began[run] < now - older_than_s
        many = keep_gb is not None and left > keep_gb * 1e9
        if old or many:
            doomed.append(run)
            left -= run.bytes
    return doomed


def goes_on(folder: Path, run: Run) -> bool:
    """Return whether a run may still go on: then nothing of it is removed."""
    if folder.resolve() in announced_folders():
        return True
    return not run.result_ns and time.time() - folder.stat().st_mtime < FRESH_S


def export(arguments: argparse.Namespace) -> None:
    run, copy = find(arguments.runs, arguments.run), arguments.copy
    if copy.suffix == ".zip":
        left_out = exported(run, copy, arguments.whole)
        end = f"{copy}: `qmn runs import {copy.name}` makes a run of it"
    elif arguments.whole:
        raise BadRequest(f"--whole: {copy} would be a folder; name a file, as {copy}.zip")
    else:
        left_out = share(run, copy)
        end = f"copied to {copy}"
    for name in left_out:
        print(f"left out: {name}")
    print(end)


def take(arguments: argparse.Namespace) -> None:
    folder = imported(arguments.file, arguments.runs)
    print(f"{folder}: look at it by `qmn live {folder}` or `qmn report {folder}`")
