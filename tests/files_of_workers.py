"""Shares test files among the workers of pytest-xdist, so that each file is collected once.

With --dist=each, by which a worker runs all that it has collected: here files of its own. The
largest go first, each to the worker that has the fewest bytes.
"""

from collections.abc import Iterable
from pathlib import Path

import pytest


def shares(files: Iterable[Path], workers: int) -> list[set[Path]]:
    """Return the files of each worker."""
    own: list[set[Path]] = [set() for _ in range(workers)]
    loads = [0] * workers
    by_size = ((file.stat().st_size, file) for file in files)
    for size, file in sorted(by_size, reverse=True):
        least = loads.index(min(loads))
        own[least].add(file)
        loads[least] += size
    return own


class Share:
    """Lets a worker collect no other files of tests than its own."""

    def __init__(self, own: set[Path]) -> None:
        self._own = own

    def pytest_ignore_collect(self, collection_path: Path) -> bool | None:
        """Leave out what other workers collect."""
        others = collection_path.match("test_*.py") and collection_path not in self._own
        return True if others else None


def pytest_configure(config: pytest.Config) -> None:
    """Share the files of the command line; those of several workers are all of them."""
    if (worker := getattr(config, "workerinput", None)) is None:
        return
    named = [config.invocation_params.dir / text.partition("::")[0] for text in config.args]
    files = {
        file for path in named for file in ([path] if path.is_file() else path.rglob("test_*.py"))
    }
    number = int(worker["workerid"].removeprefix("gw"))
    config.pluginmanager.register(Share(shares(files, worker["workercount"])[number]))
