"""Words on the lines of a drawing, which keep clear of each other and of its nodes."""

from collections.abc import Iterable, Sequence
from math import atan2, ceil, degrees, dist
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from views.report.drawing import PAPER
from views.report.places import NODE_INCHES, Place

BUNDLE_INCHES = 0.3  # of lines beside each other, at most
LETTER_INCHES, LINE_INCHES = 0.058, 0.15
LABEL: dict[str, Any] = {"fontsize": 8, "va": "center", "zorder": 3}
LABEL_SHARES = sorted(np.linspace(0.28, 0.74, 24).tolist(), key=lambda share: abs(share - 0.42))
CLEAR_INCHES = 0.12  # between labels


class Labels:
    """The words on a drawing, collected and then written where there is room."""

    def __init__(self, axes: Axes, nodes: Iterable[Place]) -> None:
        self._axes = axes
        self._asked: list[tuple[tuple[Place, Place], str, bool]] = []
        across, down = (np.linspace(-size / 2, size / 2, 7) for size in NODE_INCHES)
        self._taken = [(x + dx, y + dy) for x, y in nodes for dx in across for dy in down[1::4]]

    def add(self, ends: tuple[Place, Place], text: str, needed: bool) -> None:
        """Take a label; one that is not needed is left out if there is no room."""
        self._asked.append((ends, text, needed))

    def write(self) -> None:
        """Write all labels: first those that have one place alone, then those that are needed."""
        self._asked.sort(key=lambda asked: (not _upright(asked[0]), not asked[2]))
        for ends, text, needed in self._asked:
            if _upright(ends):
                self._write_beside(ends, text)
            else:
                self._write_along(ends, text, needed)

    def _write_beside(self, ends: tuple[Place, Place], text: str) -> None:
        (x1, y1), (_x2, y2) = ends
        x, y = x1 + BUNDLE_INCHES / 2 + 0.08, (y1 + y2) / 2
        self._axes.text(x, y, text, ha="left", **LABEL)
        length = LETTER_INCHES * max(map(len, text.split("\n")))
        self._taken += _extent(((x, y), (x + length, y)), 0.5, text)

    def _write_along(self, ends: tuple[Place, Place], text: str, needed: bool) -> None:
        (x1, y1), (x2, y2) = ends
        share = max(LABEL_SHARES, key=lambda share: self._clear(_extent(ends, share, text)))
        extent = _extent(ends, share, text)
        if not needed and self._clear(extent) < CLEAR_INCHES:
            return
        self._taken += extent
        self._axes.text(
            x1 + share * (x2 - x1),
            y1 + share * (y2 - y1),
            text,
            ha="center",
            rotation=degrees(atan2(y1 - y2, x2 - x1)),
            bbox={"facecolor": PAPER, "edgecolor": "none", "pad": 0.4},
            **LABEL,
        )

    def _clear(self, extent: Sequence[Place]) -> float:
        """Return how far a label is from the others; far enough is as good as any farther."""
        nearest = min(
            (dist(one, two) for one in extent for two in self._taken), default=LINE_INCHES
        )
        return min(nearest, LINE_INCHES)


def _upright(ends: tuple[Place, Place]) -> bool:
    return ends[0][0] == ends[1][0]


def _extent(ends: tuple[Place, Place], share: float, text: str) -> list[Place]:
    (x1, y1), (x2, y2) = ends
    length = dist(*ends)
    half = LETTER_INCHES * max(map(len, text.split("\n"))) / 2
    count = ceil(half / LINE_INCHES)
    shares = [share + n * half / count / length for n in range(-count, count + 1)]
    return [(x1 + share * (x2 - x1), y1 + share * (y2 - y1)) for share in shares]
