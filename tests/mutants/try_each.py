"""make mutants: put bugs in, one at a time, in a copy of the tree, and see which tests notice.

First the unit tests that import the file or its folder are tried, then those of its room, of all
formats and of the contract; all of them are the day's. The status is 1 if a bug is noticed by none
and not explained, or fits its file no more.
"""

import argparse
import os
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

from bugs import ROOT, Bug, bugs, unit_tests_of

PYTEST = [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", "-p", "garbage"]
DAY = ["-p", "nightly", "-m", "not nightly"]
FORMATS = "tests/unit/test_wire_formats.py"  # of every room
LONGEST_S = 1_200.0  # for the tests of a room; what hangs is noticed


def copied(folder: Path) -> Path:
    """Return a copy of the tree; its virtual environment is this one's."""
    tree = folder / "tree"
    shutil.copytree(ROOT, tree, ignore=left_out, symlinks=True)
    (tree / ".venv").symlink_to(ROOT / ".venv")
    return tree


def left_out(folder: str, names: list[str]) -> set[str]:
    """Return what is not copied: what is built, and runs of networks."""
    of_root = {".git", ".venv", "runs", "curves", "site"} if Path(folder) == ROOT else set()
    return {name for name in names if name == "__pycache__" or name.endswith("_cache")} | of_root


def fails(tree: Path, tests: Sequence[str], ignored: Sequence[str]) -> bool:
    """Run tests; return whether one fails, or they do not end."""
    environment = {**os.environ, "PYTHONPATH": "tests", "OPENBLAS_NUM_THREADS": "1"}
    environment["PYTHONDONTWRITEBYTECODE"] = "1"  # what was right a second ago must not be run
    try:
        done = subprocess.run(
            [*PYTEST, *DAY, *(f"--ignore={each}" for each in ignored), *tests],
            cwd=tree,
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            timeout=LONGEST_S,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return True
    return done.returncode not in (0, 5)  # 5: no test was collected


def of_room(tree: Path, bug: Bug) -> list[str]:
    """Return the tests of a bug's room, of the contract and of all formats."""
    others = f"tests/unit/{bug.room}", "tests/contract", FORMATS
    return [each for each in others if (tree / each).exists()]


def noticed(tree: Path, bug: Bug, near: bool, ignored: Sequence[str]) -> bool:
    """Put a bug in, run its tests, take it out; `near`: leave out those of its room."""
    file = tree / bug.file
    right = file.read_text()
    first = [test for test in unit_tests_of(bug, tree) if test not in ignored]
    file.write_text(bug.applied(right))
    try:
        return bool(first and fails(tree, first, ignored)) or (
            not near and fails(tree, of_room(tree, bug), ignored)
        )
    finally:
        file.write_text(right)


def main() -> int:
    """Try all bugs, or some; say which are not noticed."""
    parser = argparse.ArgumentParser(prog="make mutants", description=__doc__)
    parser.add_argument("--room", help="of this folder alone")
    parser.add_argument("--part", default="1/1", metavar="I/N", help="the Ith of N parts of them")
    parser.add_argument(
        "--near", action="store_true", help="try only tests that import the file or its folder"
    )
    parser.add_argument("--ignore", action="append", default=[], help="a file of tests that fails")
    arguments = parser.parse_args()
    part, parts = map(int, arguments.part.split("/"))
    chosen = [bug for bug in bugs() if arguments.room in (None, bug.room)][part - 1 :: parts]
    missed = []
    with TemporaryDirectory(prefix="qmn-mutants-") as folder:
        Path(folder).chmod(0o755)  # a test is another user
        tree = copied(Path(folder))
        near = {test for bug in chosen for test in unit_tests_of(bug, tree)}
        rooms = {test for bug in chosen for test in of_room(tree, bug)}
        if fails(tree, sorted(near if arguments.near else near | rooms), arguments.ignore):
            raise SystemExit("a test fails as all is, without a bug; run make unit")
        for number, bug in enumerate(chosen, 1):
            fits = bug.fits(tree)
            found = fits and noticed(tree, bug, arguments.near, arguments.ignore)
            missed += [] if found else [bug]
            word = "noticed" if found else "explained" if bug.explained else "NOT NOTICED"
            word = word if fits else "FITS NO MORE"
            print(f"{number}/{len(chosen)} {word}: {bug}", flush=True)
    print(f"{len(chosen) - len(missed)} of {len(chosen)} bugs are noticed")
    return int(any(not bug.explained for bug in missed))


if __name__ == "__main__":
    sys.exit(main())
