"""The picture of heavy traffic: sessions over time, and when each fibre was in use."""

from collections.abc import Sequence
from itertools import accumulate

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import EngFormatter, MaxNLocator

from views.fiber_use import Use
from views.report import drawing
from views.report.drawing import BAD, METADATA, QUANTUM
from wire.results.run_result import ACCEPTED, Load, LoadSession

WIDTH_INCHES, SESSIONS_INCHES, ROW_INCHES, REST_INCHES = 8.6, 2.0, 0.16, 0.7
MOST_FIBERS = 60
BAR = 0.7  # of a row's height
Step = tuple[float, int]  # when, and by how much


@drawing.styled
def load_diagram(load: Load, use: Use, scale: float) -> str:
    """Draw how many sessions have light and wait for it, refusals, and the busiest fibres."""
    lines = busiest(use)
    heights = SESSIONS_INCHES, max(1, len(lines)) * ROW_INCHES
    made = Figure(figsize=(WIDTH_INCHES, sum(heights) + REST_INCHES), layout="constrained")
    above, below = made.subplots(2, 1, sharex=True, height_ratios=heights)
    _sessions(above, load.sessions)
    _fibers(below, lines, load.began_ns, scale)
    made.legend(loc="outside upper center", ncols=3)
    return drawing.svg(made, "sessions over time, and the use of every fibre")


def busiest(use: Use) -> Use:
    """Return the fibres that were in use longest, in the order of their names."""
    times = {name: sum(end - begin for begin, end in parts) for name, parts in use.items()}
    names = sorted((name for name in use if times[name]), key=lambda name: -times[name])
    return {name: use[name] for name in sorted(names[:MOST_FIBERS])}


def _sessions(axes: Axes, sessions: Sequence[LoadSession]) -> None:
    light: list[Step] = []
    waiting: list[Step] = []
    for each in sessions:
        ready_s = each.ended_s
        if each.setup_s is not None:
            ready_s = each.asked_s + each.setup_s
            light += [(ready_s, 1), (each.ended_s, -1)]
        waiting += [(each.asked_s, 1), (ready_s, -1)]
    for steps, colour, label in (
        (light, QUANTUM, "with light"),
        (waiting, METADATA, "without yet"),
    ):
        times, counts = counted(steps)
        axes.step(times, counts, where="post", color=colour, linewidth=1.4, label=label)
    refused = [session.ended_s for session in sessions if session.outcome != ACCEPTED]
    axes.plot(
        refused, [0.0] * len(refused), "|", color=BAD, markersize=9, label="refused", clip_on=False
    )
    axes.set_ylim(bottom=0)
    axes.set_ylabel("sessions")
    axes.yaxis.set_major_locator(MaxNLocator(integer=True, nbins=5))


def counted(steps: Sequence[Step]) -> tuple[list[float], list[int]]:
    in_order = sorted(steps)
    return [at for at, _by in in_order], list(accumulate(by for _at, by in in_order))


def _fibers(axes: Axes, use: Use, began_ns: int, scale: float) -> None:
    for row, intervals in enumerate(use.values()):
        bars = [((a - began_ns) / 1e9 / scale, (b - a) / 1e9 / scale) for a, b in intervals]
        axes.broken_barh(bars, (row - BAR / 2, BAR), color=QUANTUM)
    axes.set_yticks(range(len(use)), list(use), fontsize=6)
    axes.set_ylim(len(use) - 0.5, -0.5)
    axes.set_xlabel("time since the first session could be asked for")
    axes.xaxis.set_major_locator(MaxNLocator(nbins=8))
    axes.xaxis.set_major_formatter(EngFormatter(unit="s"))
