"""The points that a user asks for: flags and TOML files turned into values, all checked first."""

import math
import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

from evidence.curves.experiment import Experiment, Outcome
from evidence.curves.parameters import BadGrid, Value, Values
from wire.parameters.checks import check_names

MAX_POINTS = 10_000
MAX_PAIRS = 100_000_000_000
FILE_KEYS = ("sweep", "seed", "grid")


@dataclass(frozen=True)
class Grid:
    """Every combination of the values on the axes."""

    experiment: Experiment
    axes: dict[str, list[Value]]

    def points(self) -> Iterator[Values]:
        for combination in product(*self.axes.values()):
            yield self.experiment.complete(dict(zip(self.axes, combination, strict=True)))

    @property
    def size(self) -> int:
        return math.prod(len(axis) for axis in self.axes.values())

    @property
    def varied(self) -> list[str]:
        return [name for name, axis in self.axes.items() if len(axis) > 1]


Row = tuple[Values, Outcome]
# Measures points of a grid with a seed, in any order.
Measurer = Callable[[Grid, Sequence[Values], int], Iterator[Row]]


def build(experiment: Experiment, content: Mapping[str, object]) -> Grid:
    """Return the grid that texts, numbers, lists or tables describe; raise BadGrid."""
    axes = {name: experiment.parameter(name).axis(text) for name, text in content.items()}
    grid = Grid(experiment, axes)
    if grid.size > MAX_POINTS:
        sizes = " x ".join(f"{len(axis)} {name}" for name, axis in axes.items())
        raise BadGrid(f"{grid.size:,} points ({sizes}): at most {MAX_POINTS:,} in one sweep")
    pairs = axes.get("pairs", [experiment.complete({}).get("pairs", 0)])
    total = grid.size // len(pairs) * sum(int(pair) for pair in pairs)
    if total > MAX_PAIRS:
        raise BadGrid(f"{total:,} pairs in all points: at most {MAX_PAIRS:,} in one sweep")
    return grid


def read(path: Path) -> dict[str, Any]:
    """Return what a TOML file asks for: the keys FILE_KEYS; raise BadGrid."""
    try:
        content = tomllib.loads(path.read_text())
    except OSError as error:
        raise BadGrid(f"cannot read {path}: {error.strerror}") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise BadGrid(f"{path} is not a TOML file: {error}") from error
    check_names(str(path), content, FILE_KEYS, BadGrid)
    if not isinstance(content.get("sweep"), str):
        raise BadGrid(f'{path} does not say what to sweep: sweep = "sdc", for example')
    if not isinstance(content.get("grid", {}), dict):
        raise BadGrid(f"{path}: grid is not a table: write [grid]")
    return content
