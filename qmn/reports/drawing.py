"""Figures of a page: SVG, whose colours and sizes the page decides by CSS.

Colours are variables of the page, so that the same figure is right on white and on black.
"""

from collections.abc import Sequence
from html import escape
from math import atan2, cos, sin

from qmn.reports.places import Place  # inches to the right of the top left corner, and below it

INK, MUTED, GRID, PAPER = "var(--ink)", "var(--muted)", "var(--grid)", "var(--paper)"
METADATA, QUANTUM, OPENFLOW, BAD = (
    f"var(--{name})" for name in ("metadata", "quantum", "openflow", "bad")
)
PATHS = (QUANTUM, *(f"var(--path-{number})" for number in (1, 2, 3)))  # beside each other
POINTS = 72  # an inch: what sizes of letters and widths of lines are in
CAPITAL = 0.35  # of a letter's size: from its middle to its foot
LINE = 1.2  # of a letter's size: from one line of a text to the next
HEAD_INCHES = 0.09, 0.035  # of an arrow: its length, and half of its width
ANCHORS = {"left": "start", "center": "middle", "right": "end"}


class Drawing:
    """A figure of inches; what is drawn later covers what is there."""

    def __init__(self, width: float, height: float) -> None:
        self.width, self.height = width, height
        self._parts: list[str] = []

    def line(
        self,
        places: Sequence[Place],
        colour: str,
        width: float = 1.0,
        dashes: Sequence[float] = (),
        alpha: float = 1.0,
    ) -> None:
        """Draw a line through places, so many points wide; dashes are in these widths."""
        if not places:
            return
        style = f"fill: none; stroke: {colour}; stroke-width: {width:g}"
        if dashes:
            style += f"; stroke-dasharray: {' '.join(f'{width * each:g}' for each in dashes)}"
        steps = " L ".join(map(_place, places))
        self._path(f"M {steps}", style, alpha)

    def box(
        self,
        corner: Place,
        size: Place,
        fill: str,
        alpha: float = 1.0,
        edge: str = "none",
        edge_width: float = 1.4,
        radius: float = 0.0,
    ) -> None:
        """Draw a box from its top left corner; its own corners are round by a radius."""
        (x, y), (width, height) = corner, size
        right, low = x + width, y + height
        corners = [(x, y), (right, y), (right, low), (x, low)]
        begins = [(x, y + radius), (right - radius, y), (right, low - radius), (x + radius, low)]
        ends = [(x + radius, y), (right, y + radius), (right - radius, low), (x, low - radius)]
        turns = zip(begins, corners, ends, strict=True)
        steps = " L ".join(f"{_place(a)} Q {_place(b)} {_place(c)}" for a, b, c in turns)
        style = f"fill: {fill}; stroke: {edge}; stroke-width: {edge_width:g}"
        self._path(f"M {steps} Z", style, alpha)

    def dot(self, center: Place, radius: float, colour: str) -> None:
        """Draw a disk."""
        size = f"{_number(radius)} {_number(radius)} 0 1 0"
        (x, y) = center
        left, right = _place((x - radius, y)), _place((x + radius, y))
        self._path(f"M {left} A {size} {right} A {size} {left} Z", f"fill: {colour}")

    def arrow(
        self, begin: Place, end: Place, colour: str, width: float, dashes: Sequence[float] = ()
    ) -> None:
        """Draw an arrow."""
        way, (length, half) = atan2(end[1] - begin[1], end[0] - begin[0]), HEAD_INCHES
        ahead, aside = (cos(way), sin(way)), (-sin(way), cos(way))
        foot = end[0] - length * ahead[0], end[1] - length * ahead[1]
        self.line((begin, foot), colour, width, dashes)
        sides = [(foot[0] + each * aside[0], foot[1] + each * aside[1]) for each in (half, -half)]
        self._path(f"M {' L '.join(map(_place, (end, *sides)))} Z", f"fill: {colour}")

    def text(
        self,
        place: Place,
        text: str,
        colour: str = INK,
        size: float = 10.0,
        align: str = "center",
        above: bool = False,
        bold: bool = False,
        turned: float = 0.0,
        clear: bool = False,
    ) -> None:
        """Write lines with their middle at a place, or above it, turned by degrees to the left.

        What is below them is `clear` of lines then.
        """
        style = f"fill: {colour}; font-size: {size:g}px; text-anchor: {ANCHORS[align]}"
        if bold:
            style += "; font-weight: 700"
        if clear:
            style += f"; paint-order: stroke; stroke: {PAPER}; stroke-width: 4px"
        lines = text.split("\n")
        x, y = place[0] * POINTS, place[1] * POINTS
        turn = f' transform="rotate({-turned:.2f} {x:.2f} {y:.2f})"' if turned else ""
        foot = y + (0 if above else CAPITAL * size) - LINE * size * (len(lines) - 1) / 2
        self._parts += [
            f'<text x="{x:.2f}" y="{foot + LINE * size * n:.2f}"{turn} style="{style}">'
            f"{escape(line, quote=False)}</text>"
            for n, line in enumerate(lines)
        ]

    def _path(self, steps: str, style: str, alpha: float = 1.0) -> None:
        opacity = f"; opacity: {alpha:.3g}" if alpha < 1 else ""
        self._parts.append(f'<path d="{steps}" style="{style}{opacity}"/>')

    def svg(self, label: str) -> str:
        """Return the figure as an element of a page; `label` is for those who do not see it."""
        box = f"0 0 {_number(self.width)} {_number(self.height)}"
        head = f'<svg viewBox="{box}" role="img" aria-label="{escape(label)}">'
        return "\n".join([head, *self._parts, "</svg>"])


def _place(place: Place) -> str:
    return f"{_number(place[0])} {_number(place[1])}"


def _number(inches: float) -> str:
    return f"{inches * POINTS:.2f}".rstrip("0").rstrip(".")
