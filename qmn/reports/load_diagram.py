"""The picture of heavy traffic: sessions over time, and when each fibre was in use."""

from collections.abc import Mapping, Sequence
from itertools import accumulate
from typing import Any

from qmn.reports.axes import Axes, Frame, legend, round_values, ticks
from qmn.reports.drawing import BAD, METADATA, QUANTUM, Drawing
from qmn.traffic.fiber_use import Use
from qmn.traffic.session import ACCEPTED

WIDTH_INCHES, SESSIONS_INCHES, ROW_INCHES, REST_INCHES = 8.6, 2.0, 0.16, 0.7
TOP_INCHES, SPACE_INCHES = 0.4, 0.15
NAME_INCHES = 0.05  # of a letter of a fibre's name
NAME_SIZE = 6
REFUSED_INCHES = 0.06  # half of a stroke
MOST_FIBERS = 60
BAR = 0.7  # of a row's height
Step = tuple[float, int]  # when, and by how much


def load_diagram(load: Mapping[str, Any], use: Use, scale: float) -> str:
    """Draw how many sessions have light and wait for it, refusals, and the busiest fibres."""
    lines = busiest(use)
    fibers_inches = max(1, len(lines)) * ROW_INCHES
    between = TOP_INCHES + SESSIONS_INCHES
    height = between + SPACE_INCHES + fibers_inches + REST_INCHES
    drawing = Drawing(WIDTH_INCHES, height)
    left, right = 0.8 + NAME_INCHES * max(map(len, lines), default=0), WIDTH_INCHES - 0.3
    began_ns, sessions = load["began_ns"], load["sessions"]
    bars = {
        name: [((a - began_ns) / 1e9 / scale, (b - began_ns) / 1e9 / scale) for a, b in intervals]
        for name, intervals in lines.items()
    }
    last = max(
        [*(each["ended_s"] for each in sessions), *(b for each in bars.values() for _a, b in each)]
    )
    x = 0.0, max(1.02 * last, 1e-6)
    _sessions(drawing, Frame(left, TOP_INCHES, right, between), x, sessions)
    begin = between + SPACE_INCHES
    _fibers(drawing, Frame(left, begin, right, begin + fibers_inches), x, bars)
    legend(
        drawing,
        [("with light", QUANTUM, ()), ("without yet", METADATA, ()), ("refused", BAD, ())],
    )
    return drawing.svg("sessions over time, and the use of every fibre")


def busiest(use: Use) -> Use:
    """Return the fibres that were in use longest, in the order of their names."""
    times = {name: sum(end - begin for begin, end in parts) for name, parts in use.items()}
    kept = sorted((name for name in use if times[name]), key=lambda name: -times[name])
    return {name: use[name] for name in sorted(kept[:MOST_FIBERS])}


def _sessions(
    drawing: Drawing,
    frame: Frame,
    x: tuple[float, float],
    sessions: Sequence[Mapping[str, Any]],
) -> None:
    light: list[Step] = []
    waiting: list[Step] = []
    for each in sessions:
        ready_s = each["ended_s"]
        if each["setup_s"] is not None:
            ready_s = each["asked_s"] + each["setup_s"]
            light += [(ready_s, 1), (each["ended_s"], -1)]
        waiting += [(each["asked_s"], 1), (ready_s, -1)]
    lines = [(counted(light), QUANTUM), (counted(waiting), METADATA)]
    top = 1.05 * max([1, *(count for (_times, counts), _ in lines for count in counts)])
    axes = Axes(drawing, frame, x, (0, top))
    axes.x_axis([(each, "") for each in round_values(*x, 8)])
    axes.y_axis(ticks(round_values(0, top, 5, whole=True)), "sessions")
    for (times, counts), colour in lines:
        axes.steps(times, counts, colour, 1.4)
    for each in sessions:
        if each["outcome"] != ACCEPTED:
            place, low = axes.at(each["ended_s"], 0.0)
            ends = (place, low - REFUSED_INCHES), (place, low + REFUSED_INCHES)
            drawing.line(ends, BAD)


def counted(steps: Sequence[Step]) -> tuple[list[float], list[int]]:
    """Return the moments of steps in order, and the count from each on."""
    in_order = sorted(steps)
    return [at for at, _by in in_order], list(accumulate(by for _at, by in in_order))


def _fibers(
    drawing: Drawing,
    frame: Frame,
    x: tuple[float, float],
    bars: Mapping[str, Sequence[tuple[float, float]]],
) -> None:
    axes = Axes(drawing, frame, x, (max(1, len(bars)) - 0.5, -0.5))
    text = "time since the first session could be asked for"
    axes.x_axis(ticks(round_values(*x, 8), "s"), text)
    axes.y_axis([*enumerate(bars)], size=NAME_SIZE)
    for row, intervals in enumerate(bars.values()):
        for interval in intervals:
            axes.span(interval, (row - BAR / 2, row + BAR / 2), QUANTUM, 1.0)
