"""make mutants: put bugs in, one at a time, in a copy of the tree, and see which tests notice.

First the tests that import its file are tried and the test that it names, then those
of its room that import its folder, then all of its room, of formats and of the contract, then
others that import its folder; all are the day's. A test notices a bug if it fails with it and
passes without. The status is 1 if a bug is noticed by none and not explained, or fits no more.
"""

import argparse
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

from bugs import ROOT, Bug, bugs, nearest_tests

PYTEST = [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", "-p", "garbage"]
DAY = ["-p", "nightly", "-m", "not nightly", "--tb=no", "-rfE"]
LONGEST = "--timeout=120", "--timeout-method=thread"  # what hangs is noticed, and ends
MOST_S = 1_800.0  # of all that is run at once
FORMATS = "tests/unit/test_wire_formats.py"  # of every room
FAILED = re.compile(r"^(?:FAILED|ERROR) ([^\s\[]+)", re.M)  # without parameters
DESCRIBED = ("qmn", "topologies", "wire")  # rooms of what the contract walks
NEAREST = 3  # files of tests
UNNAMED = "pytest itself"
NONE_COLLECTED = 5  # a status of pytest


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


def failure(tree: Path, tests: Sequence[str], excluded: Sequence[str] = ()) -> str:
    """Run tests; return the first that fails, or why they end otherwise, or "" if all pass.

    Files among the excluded are left out whole: they cannot be collected.
    """
    tests = [each for each in tests if each not in excluded]
    if not tests:
        return ""
    environment = {**os.environ, "PYTHONPATH": "tests", "OPENBLAS_NUM_THREADS": "1"}
    environment["PYTHONDONTWRITEBYTECODE"] = "1"  # what was right a second ago must not be run
    namespaces = ["topologies/own_namespaces"] if tests[0].startswith("tests/emulation") else []
    try:
        done = subprocess.run(
            [*namespaces, *PYTEST, *DAY, *LONGEST, *map(left_out_by, excluded), *tests],
            cwd=tree,
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            check=False,
            text=True,
            timeout=MOST_S,
        )
    except subprocess.TimeoutExpired:  # a thread that a test has left, say, ends never
        return UNNAMED
    if done.returncode in (0, NONE_COLLECTED):
        return ""
    failed = FAILED.search(done.stdout)
    return failed[1] if failed else UNNAMED


def left_out_by(test: str) -> str:
    """Return pytest's option without which a test, or a file of tests, is run."""
    return f"--deselect={test}" if "::" in test else f"--ignore={test}"


def stages(tree: Path, bug: Bug, near: bool) -> Iterator[list[str]]:
    """Yield the tests to try, nearest first."""
    of_file, of_folder = nearest_tests(bug, tree)
    yield [bug.test] if bug.test else []
    yield of_file[:NEAREST]  # most bugs go no further
    yield of_file[NEAREST:]
    yield ["tests/contract"] if bug.room in DESCRIBED else []
    if not near:
        room = f"tests/unit/{bug.room}"
        yield [test for test in of_folder if test.startswith(room)]
        yield [each for each in (room, FORMATS) if (tree / each).exists()]
        yield [test for test in of_folder if not test.startswith(room)]


def noticing(tree: Path, bug: Bug, near: bool, broken: list[str]) -> str:
    """Return the test that notices a bug, or ""; append those that fail without it to `broken`."""
    file = tree / bug.file
    right = file.read_text()
    for tests in filter(None, stages(tree, bug, near)):
        while True:
            file.write_text(bug.applied(right))
            try:
                failed = failure(tree, tests, broken)
            finally:
                file.write_text(right)
            if not failed:
                break
            if not failure(tree, tests if failed == UNNAMED else [failed]):
                return failed
            broken.append(failed)
    return ""


def main() -> int:
    """Try all bugs, or some; say which are not noticed."""
    parser = argparse.ArgumentParser(prog="make mutants", description=__doc__)
    parser.add_argument("--room", help="of this folder alone")
    parser.add_argument("--file", nargs="*", help="of these files alone")
    parser.add_argument("--kind", help="of this kind alone")
    parser.add_argument("--part", default="1/1", metavar="I/N", help="the Ith of N parts of them")
    parser.add_argument(
        "--near",
        action="store_true",
        help="only tests that import the file, and the test that it names",
    )
    arguments = parser.parse_args()
    part, parts = map(int, arguments.part.split("/"))
    chosen = [
        bug
        for bug in bugs()
        if arguments.room in (None, bug.room)
        and arguments.kind in (None, bug.kind)
        and (arguments.file is None or bug.file in arguments.file)
    ][part - 1 :: parts]
    missed = []
    broken: list[str] = []
    with TemporaryDirectory(prefix="qmn-mutants-") as folder:
        Path(folder).chmod(0o755)  # a test is another user
        tree = copied(Path(folder))
        for number, bug in enumerate(chosen, 1):
            fits = bug.fits(tree)
            tried = fits and not bug.explained
            test = noticing(tree, bug, arguments.near, broken) if tried else ""
            missed += [] if test else [bug]
            word = f"noticed by {test}" if test else "explained" if bug.explained else "NOT NOTICED"
            word = word if fits else "FITS NO MORE"
            print(f"{number}/{len(chosen)} {word}: {bug}", flush=True)
    for test in broken:
        print(f"fails without a bug, too: {test}")
    print(f"{len(chosen) - len(missed)} of {len(chosen)} bugs are noticed")
    return int(any(not bug.explained for bug in missed))


if __name__ == "__main__":
    sys.exit(main())
