"""A lab: a published result, the runs of the network that are held beside it, and how.

Each is a folder of labs/ with a module of its name, which says LAB = Lab(…), and a page, README.md.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from evidence.curves.estimates import SIGMAS, Estimate, mean_of_draws
from evidence.curves.experiment import Outcome
from qmn.results import schema


@dataclass(frozen=True)
class Published:
    """A number that a paper states, with its standard error.

    If no error is to be read, it is half a unit of the last digit; 0 is that of a closed form, or
    of a count.
    """

    value: float
    error: float
    source: str  # which part of the paper says it
    half_range: float = 0.0  # of a range that a paper states: the value is its middle
    differs: str = ""  # why ours is another one, as far as known: it is reported, and no fault


@dataclass(frozen=True)
class Finding:
    """A number of ours, and what is published beside it."""

    chart: str  # that draws it, by name; "": none
    what: str
    ours: Estimate
    published: Published | None = None  # None: a point of our curve alone
    at: float | None = None  # place on the chart's axis
    at_error: float = 0.0  # its standard error, as the paper has it
    # Standard error of ours that follows from those of the parameters that the paper gives.
    inputs: float = 0.0

    @property
    def error(self) -> float:
        """The standard error of ours, that of the parameters in it."""
        return math.hypot(self.ours.error, self.inputs)

    @property
    def difference(self) -> float | None:
        """How many standard errors ours is above; None where nothing is published.

        Of a range: how many beyond its end.
        """
        if self.published is None:
            return None
        apart = self.ours.value - self.published.value
        if abs(apart) <= self.published.half_range:
            return 0.0
        apart -= math.copysign(self.published.half_range, apart)
        error = math.hypot(self.error, self.published.error)
        return apart / error if error else math.copysign(math.inf, apart)

    def agrees(self, tolerance: float) -> bool:
        """Return whether it is within a number of standard errors; False without a measurement.

        A figure that is known to differ agrees.
        """
        if self.difference is None or (self.published is not None and self.published.differs):
            return True
        return abs(self.difference) <= tolerance


def exactly(what: str, ours: float, published: float, source: str) -> Finding:
    """Return the finding of a number that has no error: both are the same, or they differ."""
    return Finding("", what, Estimate(ours, 0.0), Published(published, 0.0, source))


def in_range(what: str, ours: Estimate, low: float, high: float, source: str) -> Finding:
    """Return the finding of a number of which a range is published: inside, nothing differs."""
    published = Published((low + high) / 2, 0.0, source, (high - low) / 2)
    return Finding("", what, ours, published)


def paired(what: str, ours: ArrayLike, theirs: ArrayLike, source: str) -> Finding:
    """Return the finding of what both have measured of the same draws, one by one.

    Errors are those of the differences, as large in ours as in theirs.
    """
    our, their = np.asarray(ours), np.asarray(theirs)
    error = mean_of_draws(our - their).error / math.sqrt(2)
    published = Published(float(their.mean()), error, source)
    return Finding("", what, Estimate(float(our.mean()), error), published)


@dataclass(frozen=True)
class PublishedRow:
    """A published figure that needs no network: `qmn lab curves` has the physical layer give it.

    `points` are experiments of evidence.curves with values of their parameters; `of` makes our
    figure from the measurements, in this order (from none, where it follows from formulas of
    the product alone).
    """

    paper: str  # arXiv:… or doi …
    what: str
    published: Published
    of: Callable[..., Estimate]
    points: Sequence[tuple[str, Mapping[str, object]]] = ()
    inputs: float = 0.0  # as of a Finding

    def finding(self, outcomes: Sequence[Outcome]) -> Finding:
        source = f"{self.paper}: {self.published.source}"
        published = replace(self.published, source=source)
        return Finding("", self.what, self.of(*outcomes), published, inputs=self.inputs)


@dataclass(frozen=True)
class Chart:
    """The content of a lab's figure; axes have their units in the labels."""

    name: str
    title: str
    x: str
    y: str
    theory: Callable[[float], float] | None = None
    logarithmic: bool = False
    ours: str = "this model, in the network"  # the label of our points
    theirs: str = "published"  # of the stars


@dataclass(frozen=True)
class Run:
    """A run of the network that has ended: its folder, and what its result.json says."""

    folder: Path
    result: dict[str, Any]

    @property
    def job(self) -> Any:
        """The result of a `qmn run`, by attributes (wire.results.run_result, figures)."""
        return schema.read_run(self.result).job

    def times_s(self, kind: str) -> list[float]:
        """Return when events of a kind were, by the event log of a stepped run, in seconds.

        They count from the log's first event on.
        """
        lines = (self.folder / "quantum.log").read_text().splitlines()
        events = [line.split(maxsplit=3)[:3] for line in lines]
        first = datetime.fromisoformat(events[0][0])
        return [
            (datetime.fromisoformat(when) - first).total_seconds()
            for when, _node, what in events
            if what == kind
        ]


Runs = Mapping[str, Run]


@dataclass(frozen=True)
class Lab:
    """A published result as runs of the network."""

    title: str
    paper: str
    runs: Mapping[str, str]  # by name: the words behind `qmn`, but for --seed and --runs
    findings: Callable[[Runs], Sequence[Finding]]
    charts: Sequence[Chart] = field(default=())
    rows: Sequence[PublishedRow] = field(default=())  # of the same papers, without a network
    tolerance: float = SIGMAS  # standard errors
    theirs: str = "published"  # what stands beside ours
    # Writes further files into the lab's folder, and returns them.
    files: Callable[[Runs, Path], Sequence[Path]] = lambda _runs, _folder: ()
