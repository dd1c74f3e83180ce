"""Two drawings of a run: its network with the light paths, and its handshake."""

from collections.abc import Sequence
from math import atan2, degrees

from matplotlib.axes import Axes
from matplotlib.patches import Circle, FancyBboxPatch

from qmn.network_facts import NetworkFacts
from qmn.reports import drawing, sequence
from qmn.reports.drawing import BAD, INK, METADATA, MUTED, OPENFLOW, PAPER, QUANTUM
from qmn.reports.light_paths import LightPath, fiber_name
from qmn.reports.sequence import Step

COLOURS = {sequence.METADATA: METADATA, sequence.OPENFLOW: OPENFLOW, sequence.QUANTUM: QUANTUM}
ROW_INCHES, LANE_INCHES, TIMES_INCHES, HEAD_INCHES = 0.24, 1.75, 1.0, 0.45
NETWORK_INCHES = (8.6, 4.2)  # at least so high
COLUMNS = (0.075, 0.28, 0.58, 0.92)  # shares of the width
NODE_ROW_INCHES = 0.62
NODE_INCHES = (0.95, 0.36)
Place = tuple[float, float]


@drawing.styled
def network(facts: NetworkFacts, paths: Sequence[LightPath]) -> str:
    """Draw hosts, switches, copper and fibres with length and loss; light paths are strong."""
    columns = _columns(facts)
    width, height = NETWORK_INCHES
    height = max(height, NODE_ROW_INCHES * max(map(len, columns)))
    places = {
        name: (share * width, height * (number + 0.5) / len(names))
        for names, share in zip(columns, COLUMNS, strict=True)
        for number, name in enumerate(names)
    }
    made, axes = drawing.diagram(width, height)
    for node1, _interface1, node2, _interface2 in facts.copper:
        if node1 in places and node2 in places:
            to_quantum = {node1, node2} & {switch.name for switch in facts.switches}
            colour = drawing.GRID if to_quantum else MUTED  # those pass behind hosts
            _line(axes, places[node1], places[node2], colour, dashed=True)
    lit = {hop.name for path in paths for hop in path.hops if hop.ends != ("", "")}
    beside: dict[frozenset[str], int] = {}
    for fiber in facts.fibers:
        ends = frozenset((fiber.a.node, fiber.b.node))
        number = beside[ends] = beside.get(ends, -1) + 1
        count = sum(frozenset((each.a.node, each.b.node)) == ends for each in facts.fibers)
        offset = (number - (count - 1) / 2) * 0.34
        begin, end = _moved(places[fiber.a.node], places[fiber.b.node], offset)
        used = fiber_name(fiber) in lit
        _line(axes, begin, end, QUANTUM if used else MUTED, width=2.4 if used else 1.0)
        text = f"{fiber.length_km:g} km, {fiber.loss_db:.3g} dB"
        _label(axes, begin, end, text, INK if used else MUTED)
    quantum = {switch.name for switch in facts.switches}
    for node, place in places.items():
        _node(axes, place, node, facts.addresses.get(node, ""), node in quantum)
    return drawing.svg(made, "the network: hosts, switches, fibres with length and loss")


def _columns(facts: NetworkFacts) -> tuple[list[str], ...]:
    """Return the nodes in columns from left to right: classical switches, hosts, quantum switches.

    Quantum switches without a host, as spines, have a column of their own on the right. Each
    host is about as high as its switch, so that few fibres cross.
    """
    quantum = [switch.name for switch in facts.switches]
    copper = {name for link in facts.copper for name in (link[0], link[2])}
    classical = sorted(copper - facts.addresses.keys() - set(quantum))
    joined = [(fiber.a.node, fiber.b.node) for fiber in facts.fibers]
    joined += [(two, one) for one, two in joined]
    edge = [name for name in quantum if any((name, host) in joined for host in facts.addresses)]
    inner = [name for name in quantum if name not in edge]
    heights = {name: number for number, name in enumerate(edge)}
    hosts = sorted(
        facts.addresses,
        key=lambda host: min((heights[q] for q in edge if (host, q) in joined), default=len(edge)),
    )
    return classical, hosts, edge, inner


def _node(axes: Axes, place: Place, name: str, below: str, quantum: bool) -> None:
    (x, y), (width, height) = place, NODE_INCHES
    colour = QUANTUM if quantum else INK
    box = FancyBboxPatch(
        (x - width / 2, y - height / 2),
        width,
        height,
        boxstyle="round,pad=0.02,rounding_size=0.08",
        facecolor=PAPER,
        edgecolor=colour,
        linewidth=1.4,
        zorder=4,
    )
    axes.add_patch(box)
    axes.text(x, y - (0.06 if below else 0), name, ha="center", va="center", color=INK, zorder=5)
    if below:
        axes.text(x, y + 0.1, below, ha="center", va="center", color=MUTED, fontsize=7, zorder=5)


def _moved(one: Place, two: Place, offset: float) -> tuple[Place, Place]:
    """Return a line beside another that leads to the right, or up; in inches."""
    (x1, y1), (x2, y2) = sorted((one, two))
    length = ((x2 - x1) ** 2 + (y2 - y1) ** 2) ** 0.5 or 1.0
    across = (-(y2 - y1) / length * offset, (x2 - x1) / length * offset)
    return (x1 + across[0], y1 + across[1]), (x2 + across[0], y2 + across[1])


def _line(
    axes: Axes, one: Place, two: Place, colour: str, width: float = 1.0, dashed: bool = False
) -> None:
    style = (0, (3, 3)) if dashed else "-"
    (x1, y1), (x2, y2) = one, two
    axes.plot([x1, x2], [y1, y2], color=colour, linewidth=width, linestyle=style, zorder=2)


def _label(axes: Axes, one: Place, two: Place, text: str, colour: str) -> None:
    """Write along a line that leads to the right, or straight up or down."""
    (x1, y1), (x2, y2) = one, two
    # Lines that cross do so in the middle.
    place = 0.5 if x1 == x2 else 0.42
    axes.text(
        x1 + place * (x2 - x1),
        y1 + place * (y2 - y1),
        text,
        color=colour,
        fontsize=8,
        ha="center",
        va="center",
        rotation=degrees(atan2(y1 - y2, x2 - x1)),
        bbox={"facecolor": PAPER, "edgecolor": "none", "pad": 0.8},
        zorder=3,
    )


@drawing.styled
def handshake(steps: Sequence[Step], names: Sequence[str]) -> str:
    """Draw who sent what to whom; every row is a moment, with its time on the left."""
    moments = _moments(steps)
    rows = {moment: row for row, moment in enumerate(moments)}
    width = TIMES_INCHES + LANE_INCHES * len(names)
    height = HEAD_INCHES + ROW_INCHES * (len(moments) + 1)
    made, axes = drawing.diagram(width, height)
    places = {name: TIMES_INCHES + LANE_INCHES * (n + 0.5) for n, name in enumerate(names)}
    for name, x in places.items():
        _line(axes, (x, HEAD_INCHES), (x, height), drawing.GRID, width=1.2)
        axes.text(x, HEAD_INCHES / 2, name, ha="center", va="center", weight="bold", fontsize=11)
    origin = moments[0][0]
    for moment, row in rows.items():
        text = f"{(moment[0] - origin) / 1e6:.3f} ms"
        y = _height(row)
        axes.text(TIMES_INCHES - 0.1, y, text, ha="right", va="center", color=MUTED, fontsize=8)
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
    lost = step.to_lane and step.layer == sequence.METADATA and step.arrival_ns is None
    if step.to_lane:
        dashed = (0, (1, 1.5)) if step.layer == sequence.QUANTUM else "-"
        arrow = {
            "arrowstyle": "-|>",
            "color": BAD if lost else colour,
            "linewidth": 1.6 if step.layer == sequence.QUANTUM else 1.2,
            "linestyle": dashed,
            "shrinkA": 0,
            "shrinkB": 0,
        }
        axes.annotate("", end, begin, arrowprops=arrow)
    else:
        axes.add_patch(Circle(begin, 0.05, color=colour, zorder=4))
    right = end[0] >= begin[0]
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
