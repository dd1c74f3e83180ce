"""Figures of a page: matplotlib's SVG, whose colours and sizes the page decides by CSS.

Figures are drawn in colours that nobody would choose; each stands for a variable of the page,
so that the same figure is right on white and on black.
"""

import re
from collections.abc import Iterable, Sequence
from html import escape
from io import StringIO
from typing import Any

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

INK, MUTED, GRID, PAPER = "#010101", "#020202", "#030303", "#040404"
METADATA, QUANTUM, OPENFLOW, BAD = "#050505", "#060606", "#070707", "#080808"
PATHS = (QUANTUM, "#090909", "#0a0a0a", "#0b0b0b")  # light paths beside each other
VARIABLES = {
    INK: "ink",
    MUTED: "muted",
    GRID: "grid",
    PAPER: "paper",
    METADATA: "metadata",
    QUANTUM: "quantum",
    OPENFLOW: "openflow",
    BAD: "bad",
    **{colour: f"path-{number}" for number, colour in enumerate(PATHS) if number},
}
STYLE: dict[Any, Any] = {
    "svg.fonttype": "none",
    "svg.hashsalt": "qmn",
    "text.parse_math": False,  # a name may hold "$"
    "font.size": 10,
    "text.color": INK,
    "axes.edgecolor": MUTED,
    "axes.labelcolor": INK,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": GRID,
    "grid.linewidth": 0.8,
    "xtick.color": MUTED,
    "ytick.color": MUTED,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "legend.frameon": False,
    "figure.facecolor": "none",
    "axes.facecolor": "none",
    "savefig.facecolor": "none",
}
styled = mpl.rc_context(STYLE)  # decorates what draws: matplotlib asks for a style at many times
SMALL_INCHES = (4.4, 3.0)  # a chart: two beside each other, or one on a phone
# The widest labels, as "500 M" on the left: to measure them, all would be drawn twice.
LEFT_INCHES, RIGHT_INCHES, BOTTOM_INCHES, TOP_INCHES, LEGEND_INCHES = 0.76, 0.15, 0.48, 0.08, 0.4


def figure(
    width: float, height: float, left: float = LEFT_INCHES, top: float = TOP_INCHES
) -> tuple[Figure, Axes]:
    made = Figure(figsize=(width, height))
    inches = left, BOTTOM_INCHES, width - left - RIGHT_INCHES, height - BOTTOM_INCHES - top
    shares = [part / whole for part, whole in zip(inches, 2 * (width, height), strict=True)]
    return made, made.add_axes((shares[0], shares[1], shares[2], shares[3]))


def diagram(width: float, height: float) -> tuple[Figure, Axes]:
    """Return a figure of inches that its axes, which nobody sees, fill; the origin is top left."""
    made = Figure(figsize=(width, height))
    axes = made.add_axes((0, 0, 1, 1))
    axes.set_axis_off()
    axes.set_xlim(0, width)
    axes.set_ylim(height, 0)
    return made, axes


def cells(
    axes: Axes,
    columns: Sequence[str],
    rows: Sequence[str],
    drawn: Iterable[tuple[int, int, str, float, str]],
    size: int,
) -> None:
    """Draw cells of a table, each by column, row, colour, how strong that is, and text."""
    for x, y, colour, alpha, text in drawn:
        corner = x - 0.46, y - 0.44
        axes.add_patch(Rectangle(corner, 0.92, 0.88, facecolor=colour, alpha=alpha))
        axes.text(x, y, text, ha="center", va="center", color=INK, fontsize=size)
    axes.set_xlim(-0.5, len(columns) - 0.5)
    axes.set_ylim(len(rows) - 0.5, -0.5)
    axes.set_xticks(range(len(columns)), columns, fontsize=size)
    axes.set_yticks(range(len(rows)), rows, fontsize=size)
    axes.grid(visible=False)
    axes.tick_params(length=0)
    axes.spines[:].set_visible(False)


def svg(made: Figure, label: str) -> str:
    """Return the figure as an element of a page; `label` is for those who do not see it."""
    with StringIO() as text:
        made.savefig(text, format="svg", metadata={"Date": None, "Creator": None})
        drawn = text.getvalue()
    drawn = drawn[drawn.index("<svg") :]
    head, _end, body = drawn.partition(">")
    (box,) = re.findall(r'viewBox="([^"]+)"', head)
    body = re.sub(r"<metadata>.*?</metadata>", "", body, flags=re.DOTALL)
    body = re.sub(r'<g id="[^"]*">', "<g>", body)  # not unique among the figures of a page
    body = re.sub(r"#(0[1-9ab])\1\1\b", lambda found: variable(found[0]), body)
    return f'<svg viewBox="{box}" role="img" aria-label="{escape(label)}">{body}'


def variable(colour: str) -> str:
    return f"var(--{VARIABLES[colour]})"
