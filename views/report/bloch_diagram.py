"""States before and after teleportation, as vectors in the Bloch sphere."""

from collections.abc import Sequence
from math import cos, radians, sin, tau

from matplotlib.axes import Axes

from hosts.middleware.session.estimation import Estimate
from views.report import drawing
from views.report.drawing import GRID, MUTED, QUANTUM

DIRECTIONS = ((0, 0, 1), (0, 0, -1), (1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0))
LABELS = ("|0⟩", "|1⟩", "|+⟩", "|-⟩", "|+i⟩", "|-i⟩")
INCHES = (4.4, 3.4)
SLANT, DEPTH = radians(225), 0.45  # of x, which comes out of the paper
OUTSIDE = 1.14  # where labels are
Vector = tuple[float, float, float]


def lengths(arrived: int, agreed: int) -> tuple[float, float, float]:
    """Return 2F - 1, how much of a state is left along its direction, with its 95 % interval."""
    estimate = Estimate(arrived - agreed, arrived)
    low, high = estimate.interval()
    return 1 - 2 * estimate.qber, 1 - 2 * high, 1 - 2 * low


@drawing.styled
def bloch_diagram(of_states: Sequence[Sequence[int]]) -> str:
    """Draw each cardinal state that arrived: in as thin lines to the sphere, out as arrows."""
    made, axes = drawing.figure(*INCHES, left=drawing.RIGHT_INCHES)
    circle = [(cos(tau * n / 90), sin(tau * n / 90)) for n in range(91)]
    for points in ([(0, y, z) for y, z in circle], [(x, y, 0) for x, y in circle]):
        axes.plot(*zip(*map(_on_paper, points), strict=True), color=GRID, linewidth=1.2)
    for direction, label, (arrived, agreed) in zip(DIRECTIONS, LABELS, of_states, strict=True):
        if arrived:
            _state(axes, direction, label, lengths(arrived, agreed))
    axes.set_xlim(-1.75, 1.75)
    axes.set_ylim(-1.35, 1.35)
    axes.set_aspect("equal")
    axes.set_axis_off()
    return drawing.svg(made, "states before and after teleportation, in the Bloch sphere")


def _state(axes: Axes, direction: Vector, label: str, estimate: tuple[float, float, float]) -> None:
    length, low, high = estimate
    before, after, ends, place = (
        [_along(direction, each) for each in both]
        for both in ((0, 1), (0, length), (low, high), (OUTSIDE,))
    )
    axes.plot(*zip(*before, strict=True), color=MUTED, linewidth=0.9, linestyle=":")
    axes.annotate(
        "", after[1], after[0], arrowprops={"arrowstyle": "-|>", "color": QUANTUM, "lw": 2}
    )
    axes.plot(*zip(*ends, strict=True), color=QUANTUM, linewidth=7, alpha=0.3)
    side = {1: "left", -1: "right"}.get(round(place[0][0]), "center")
    axes.text(*place[0], f"{label} {length:.3f}", ha=side, va="center", fontsize=9)


def _along(direction: Vector, length: float) -> tuple[float, float]:
    x, y, z = direction
    return _on_paper((x * length, y * length, z * length))


def _on_paper(point: tuple[float, float, float]) -> tuple[float, float]:
    x, y, z = point
    return y + DEPTH * x * cos(SLANT), z + DEPTH * x * sin(SLANT)
