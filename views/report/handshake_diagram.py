"""The drawing of a handshake: both layers on one clock."""

from collections.abc import Sequence

from matplotlib.axes import Axes
from matplotlib.patches import Circle

from views.report import drawing
from views.report import sequence as layers
from views.report.drawing import BAD, GRID, METADATA, MUTED, OPENFLOW, QUANTUM
from views.report.sequence import Step

COLOURS = {layers.METADATA: METADATA, layers.OPENFLOW: OPENFLOW, layers.QUANTUM: QUANTUM}
ROW_INCHES, LANE_INCHES, TIMES_INCHES, HEAD_INCHES = 0.24, 1.75, 0.75, 0.45
LETTER_INCHES = 0.06
SHORT_NS = 1_000_000  # below, times are in microseconds
Place = tuple[float, float]


@drawing.styled
def handshake_diagram(steps: Sequence[Step], names: Sequence[str]) -> str:
    """Draw who sent what to whom; every row is a moment, with its time on the left."""
    moments = _moments(steps)
    rows = {moment: row for row, moment in enumerate(moments)}
    width = TIMES_INCHES + LANE_INCHES * len(names)
    height = HEAD_INCHES + ROW_INCHES * (len(moments) + 1)
    made, axes = drawing.diagram(width, height)
    places = {name: TIMES_INCHES + LANE_INCHES * (n + 0.5) for n, name in enumerate(names)}
    for name, x in places.items():
        axes.plot([x, x], [HEAD_INCHES, height], color=GRID, linewidth=1.2)
        axes.text(x, HEAD_INCHES / 2, name, ha="center", va="center", weight="bold", fontsize=11)
    origin = moments[0][0]
    unit_ns, unit = (1e6, "ms") if moments[-1][0] - origin >= SHORT_NS else (1e3, "µs")
    for moment, row in rows.items():
        text = f"{(moment[0] - origin) / unit_ns:.3f} {unit}"
        y = _height(row)
        axes.text(TIMES_INCHES, y, text, ha="right", va="center", color=MUTED, fontsize=8)
    for number, step in enumerate(steps):
        y1 = _height(rows[step.time_ns, number])
        y2 = y1 if step.arrival_ns is None else _height(rows[step.arrival_ns, number])
        _step(axes, step, (places[step.lane], y1), (places[step.to_lane or step.lane], y2))
    return drawing.svg(made, "the handshake: packets and quantum events in time order")


def _moments(steps: Sequence[Step]) -> list[tuple[int, int]]:
    """Return every time of every step, in order, each with the number of its step."""
    begun = [(step.time_ns, number) for number, step in enumerate(steps)]
    ended = [(s.arrival_ns, number) for number, s in enumerate(steps) if s.arrival_ns is not None]
    return sorted(begun + ended)


def _height(row: int) -> float:
    return HEAD_INCHES + ROW_INCHES * (row + 0.5)


def _step(axes: Axes, step: Step, begin: Place, end: Place) -> None:
    colour = COLOURS[step.layer]
    lost = step.to_lane and step.layer == layers.METADATA and step.arrival_ns is None
    if step.to_lane:
        dashed = (0, (1, 1.5)) if step.layer == layers.QUANTUM else "-"
        arrow = {
            "arrowstyle": "-|>",
            "color": BAD if lost else colour,
            "linewidth": 1.6 if step.layer == layers.QUANTUM else 1.2,
            "linestyle": dashed,
            "shrinkA": 0,
            "shrinkB": 0,
        }
        axes.annotate("", end, begin, arrowprops=arrow)
    else:
        axes.add_patch(Circle(begin, 0.05, color=colour, zorder=4))
    fits = begin[0] + 0.1 + LETTER_INCHES * len(step.text) < axes.get_xlim()[1]
    right = end[0] > begin[0] or (not step.to_lane and fits)
    axes.text(
        begin[0] + (0.1 if right else -0.1),
        begin[1] - (0.01 if step.to_lane else 0),
        step.text,
        color=colour,
        fontsize=8,
        ha="left" if right else "right",
        va="bottom" if step.to_lane else "center",
        zorder=5,
    )
