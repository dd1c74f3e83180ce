"""The size of the house, in figures to compare: `make house`, `make house REVISION=HEAD~20`.

python tests/house.py [REVISION]     (of the working tree, or of a revision that git knows)

The core is what a network needs; the product is the core with what stands beside it. Lines are
those of Python files that people wrote. A chain of imports is counted in files.
"""

import ast
import io
import re
import subprocess
import sys
import tarfile
import tempfile
from collections.abc import Iterable, Iterator
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
CORE = [
    *("wire", "programs", "dispatcher", "hosts", "controller_apps", "qswitch_agent", "copper"),
    *("topologies", "qmn"),
]
BESIDE = ["evidence", "applications", "views", "labs"]
LONG, MANY = 40, 7
COMMENTS = {"noqa": re.compile("# noqa"), "type: ignore": re.compile("# type: ignore")}

SURFACE = """
import argparse, inspect
from qmn.__main__ import VERBS, described

whole = {"whole": True} if "whole" in inspect.signature(described).parameters else {}

def parsers(parser):
    getattr(parser, "complete", lambda: None)()
    yield parser
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for below in dict.fromkeys(action.choices.values()):
                yield from parsers(below)

options = [
    action.option_strings[-1]
    for parser in parsers(described(**whole))
    for action in parser._actions
    if action.option_strings and action.dest not in ("help", "help_all")
]
print(len(VERBS), len(options), len(set(options)))
"""


def main(revision: str = "") -> None:
    """Print the figures of the working tree, or of a revision."""
    with tempfile.TemporaryDirectory() as folder:
        root = exported(revision, Path(folder)) if revision else ROOT
        groups = {"core": CORE, "product": CORE + BESIDE, "tests": ["tests"]}
        columns = {name: figures(root, folders) for name, folders in groups.items()}
        others = {"longest import chain": longest_chain(root, CORE + BESIDE), **surface(root)}
    print(f"{revision or 'working tree':26}", *(f"{name:>9}" for name in columns))
    for row in columns["core"]:
        print(f"{row:26}", *(f"{column[row]:9,}" for column in columns.values()))
    for row, figure in others.items():
        print(f"{row:26} {figure:9,}")


def exported(revision: str, folder: Path) -> Path:
    """Return a folder with the files of a revision, generated ones among them."""
    archive = subprocess.run(
        ["git", "archive", revision], cwd=ROOT, check=True, capture_output=True
    ).stdout
    with tarfile.open(fileobj=io.BytesIO(archive)) as files:
        files.extractall(folder)
    protocols = [str(file.relative_to(folder)) for file in folder.glob("wire/*.proto")]
    generate = [sys.executable, "-m", "grpc_tools.protoc", "-I.", "--python_out=."]
    subprocess.run([*generate, "--grpc_python_out=.", *protocols], cwd=folder, check=True)
    return folder


def figures(root: Path, folders: Iterable[str]) -> dict[str, int]:
    """Return what is counted in these folders."""
    texts = {file: file.read_text() for file in sources(root, folders)}
    trees = {file: ast.parse(text) for file, text in texts.items()}
    nodes = [node for tree in trees.values() for node in ast.walk(tree)]
    functions = [node for node in nodes if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)]
    names = [node.id for node in nodes if isinstance(node, ast.Name)]
    return {
        "lines": sum(text.count("\n") for text in texts.values()),
        "files": len(texts),
        f"functions over {LONG} lines": sum(length(each) > LONG for each in functions),
        f"of {MANY} or more parameters": sum(parameters(each) >= MANY for each in functions),
        "Any": names.count("Any"),
        **{
            name: sum(len(comment.findall(text)) for text in texts.values())
            for name, comment in COMMENTS.items()
        },
    }


def sources(root: Path, folders: Iterable[str]) -> Iterator[Path]:
    """Yield the Python files of these folders, but for generated ones."""
    for folder in folders:
        yield from (file for file in (root / folder).rglob("*.py") if "_pb2" not in file.name)


def length(function: ast.FunctionDef | ast.AsyncFunctionDef) -> int:
    """Return the lines of a function, with its signature and without decorators."""
    return (function.end_lineno or 0) - function.lineno + 1


def parameters(function: ast.FunctionDef | ast.AsyncFunctionDef) -> int:
    """Return how many parameters a function has, but for `self`, `*` and `**`."""
    arguments = function.args
    every = [*arguments.posonlyargs, *arguments.args, *arguments.kwonlyargs]
    return sum(each.arg not in ("self", "cls") for each in every)


def longest_chain(root: Path, folders: Iterable[str]) -> int:
    """Return how many files the longest chain of imports has; 0 if files import each other.

    Packages and entry points stand above their folder and do not count.
    """
    modules = {
        ".".join(file.relative_to(root).with_suffix("").parts): ast.parse(file.read_text())
        for file in sources(root, folders)
        if file.name not in ("__init__.py", "__main__.py")
    }
    below = {name: imported(tree) & modules.keys() for name, tree in modules.items()}
    chain: dict[str, int] = {}
    try:
        for name in TopologicalSorter(below).static_order():
            chain[name] = 1 + max((chain[each] for each in below[name]), default=0)
    except CycleError:
        return 0
    return max(chain.values())


def imported(tree: ast.Module) -> set[str]:
    """Return the names that a file imports, and those of their members."""
    names = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            names |= {f"{node.module}.{alias.name}" for alias in node.names} | {str(node.module)}
    return names


def surface(root: Path) -> dict[str, int]:
    """Return how many verbs and options the declared parsers have."""
    shown = subprocess.run(
        [sys.executable, "-c", SURFACE], cwd=root, check=True, stdout=subprocess.PIPE, text=True
    )
    counts = map(int, shown.stdout.split())
    return dict(zip(("verbs", "options", "distinct flags"), counts, strict=True))


if __name__ == "__main__":
    main(*sys.argv[1:])
