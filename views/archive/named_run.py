"""The run that a user means: by the path of its folder, or by its name as `qmn runs` lists it."""

import argparse
import re
import time
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from qmn.results.run_folder import STAMP
from wire.parameters.checks import remedy

RUNS = Path("runs")
NAME = re.compile(r"[1-9][0-9]{7}T[0-9]{6}-.*")
HERE = (".", "..")
SHOWN = 5  # names in an error, at most


class UnknownRun(Exception):
    """No run, or more than one, is of this name; the text says which there are."""


def is_run(path: Path) -> bool:
    return is_name(path.name) and path.is_dir() and not path.is_symlink()


def is_name(name: str) -> bool:
    if not NAME.fullmatch(name):
        return False
    try:
        stamp_of(name)
    except ValueError:  # as in the 13th month
        return False
    return True


def stamp_of(name: str) -> time.struct_time:
    """Return when the run of this name began; raise ValueError if none could be called so."""
    return time.strptime(name[:15], STAMP)


def find_run(text: str, runs: Path = RUNS) -> Path:
    """Return the named path, or that of the run of this name in the folder of runs.

    A part of the name will do if only one run has it. Raise UnknownRun, or OSError.
    """
    path = Path(text)
    named = text not in HERE and path.name == text
    if named and (runs / text).exists():
        return runs / text
    if path.exists():
        return path
    folder = runs if named else path.parent
    names = _newest_first(folder)
    meant = [name for name in names if named and text in name]
    if len(meant) == 1:
        return runs / meant[0]
    if meant:
        raise UnknownRun(f"{text!r} is of {len(meant)} runs: choose one of {_some(meant)}")
    if not names:
        remedy_words = "make one, as by `qmn run sdc`, or name the folder of a run"
        raise UnknownRun(f"there is no run {text!r}, and none in {folder}: {remedy_words}")
    raise UnknownRun(f"there is no run {text!r}: {remedy(path.name, names, [_some(names)])}")


def _newest_first(folder: Path) -> list[str]:
    paths = folder.iterdir() if folder.is_dir() else ()
    return sorted((path.name for path in paths if is_run(path)), reverse=True)


def _some(names: Iterable[str]) -> str:
    first, rest = [*names][:SHOWN], [*names][SHOWN:]
    return ", ".join(first) + (f" ({len(rest)} more: `qmn runs` lists them)" if rest else "")


def run_given(text: str) -> Path:
    """Return the path of the run that an argument means; raise ArgumentTypeError for none."""
    try:
        return find_run(text)
    except UnknownRun as error:
        raise argparse.ArgumentTypeError(str(error)) from error
    except OSError as error:
        raise argparse.ArgumentTypeError(f"{error.filename}: {error.strerror}") from error


def add_run(
    parser: argparse.ArgumentParser, otherwise: str = "", default: str | None = None
) -> None:
    """Describe the argument RUN; `otherwise` says what is meant without it, if it may be left out.

    `default` names the run that is meant then, if one is.
    """
    text = "its name, a part of it, or its folder, as latest"
    optional: dict[str, Any] = {"nargs": "?", "default": default} if otherwise else {}
    help_text = f"{text} ({otherwise})" if otherwise else text
    parser.add_argument("run", type=run_given, metavar="RUN", help=help_text, **optional)
