"""The drawing of a network: nodes, copper, fibres with length and loss, the ways light took."""

from collections import Counter
from collections.abc import Collection, Sequence
from math import dist

from matplotlib.axes import Axes
from matplotlib.patches import FancyBboxPatch

from views.report import drawing
from views.report.drawing import BAD, GRID, INK, MUTED, PAPER, PATHS, QUANTUM
from views.report.eavesdropped import NOBODY, Eavesdropped
from views.report.labels import BUNDLE_INCHES, Labels
from views.report.light_paths import LightPath, fiber_name
from views.report.places import LEAST_HEIGHT_INCHES, NODE_INCHES, WIDTH_INCHES, Place, columns
from wire.parameters.fiber import Fiber
from wire.results.run_result import NetworkFacts

NODE_ROW_INCHES = 0.72
BESIDE_INCHES, STROKE_INCHES = 0.22, 0.045  # between fibres; between paths in one
AT_SWITCH = 0.5  # of their distance at a host: many meet there


def path_colour(number: int) -> str:
    """Return the colour of the light path of this number; more than there are share some."""
    return PATHS[number % len(PATHS)]


@drawing.styled
def network_diagram(
    facts: NetworkFacts, paths: Sequence[LightPath], eve: Eavesdropped = NOBODY
) -> str:
    """Draw hosts, switches, copper and fibres with length and loss; each light path in colour."""
    filled = columns(facts)
    height = max(LEAST_HEIGHT_INCHES, NODE_ROW_INCHES * max(map(len, filled)))
    places = _places(filled, height)
    made, axes = drawing.diagram(WIDTH_INCHES, height)
    quantum = {switch.name for switch in facts.switches}
    for node1, _interface1, node2, _interface2 in facts.copper:
        if node1 in places and node2 in places:
            colour = GRID if {node1, node2} & quantum else MUTED  # those pass behind hosts
            _line(axes, (places[node1], places[node2]), colour, dashed=True)
    bundles: dict[tuple[str, str], list[Fiber]] = {}
    for fiber in facts.fibers:
        one, two = sorted((fiber.a.node, fiber.b.node), key=lambda node: places[node])
        bundles.setdefault((one, two), []).append(fiber)
    names = lit(paths)
    labels = Labels(axes, places.values())
    for (one, two), fibers in bundles.items():
        narrowing = AT_SWITCH if one in facts.addresses else 1.0
        bundle(axes, (places[one], places[two]), fibers, (paths, eve), narrowing)
        labels.add((places[one], places[two]), described(fibers), needed=used(fibers, names))
    labels.write()
    for name, place in places.items():
        node(
            axes,
            place,
            name,
            facts.addresses.get(name, ""),
            edge(name in quantum, name in eve.nodes),
        )
    return drawing.svg(made, "the network: hosts, switches, fibres with length and loss")


def _places(filled: Sequence[Sequence[str]], height: float) -> dict[str, Place]:
    """Return where each node is, in inches; columns are nearer to each other on the left."""
    shares = {3: (0.07, 0.36, 0.83), 4: (0.07, 0.25, 0.5, 0.83)}.get(len(filled))
    shares = shares or tuple((n + 0.5) / len(filled) for n in range(len(filled)))
    return {
        name: (share * WIDTH_INCHES, height * (number + 0.5) / len(names))
        for names, share in zip(filled, shares, strict=True)
        for number, name in enumerate(names)
    }


def lit(paths: Sequence[LightPath]) -> set[str]:
    return {hop.name for path in paths for hop in path.hops}


def used(fibers: Sequence[Fiber], names: Collection[str]) -> bool:
    return any(fiber_name(fiber) in names for fiber in fibers)


def described(fibers: Sequence[Fiber]) -> str:
    counts = Counter(f"{fiber.length_km:g} km, {fiber.loss_db:.3g} dB" for fiber in fibers)
    return "\n".join(f"{n} × {text}" if n > 1 else text for text, n in counts.items())  # noqa: RUF001


def bundle(
    axes: Axes,
    ends: tuple[Place, Place],
    fibers: Sequence[Fiber],
    light: tuple[Sequence[LightPath], Eavesdropped],
    narrowing: float,
) -> None:
    """Draw fibres beside each other, in each a line for every path, on that of eve.

    On the right they are as far from each other as on the left, times `narrowing`.
    """
    paths, eve = light
    apart = min(BESIDE_INCHES, BUNDLE_INCHES / max(len(fibers) - 1, 1))
    for number, fiber in enumerate(fibers):
        middle = (number - (len(fibers) - 1) / 2) * apart
        name = fiber_name(fiber)
        colours = [
            path_colour(n) for n, path in enumerate(paths) if name in {h.name for h in path.hops}
        ]
        colours = list(dict.fromkeys(colours))
        if name in eve.fibers:
            _line(axes, _moved(ends, middle, narrowing), BAD, width=6, dashed=True)
        if not colours:
            _line(axes, _moved(ends, middle, narrowing), MUTED)
        for stroke, colour in enumerate(colours):
            offset = (stroke - (len(colours) - 1) / 2) * STROKE_INCHES
            place = _moved(_moved(ends, middle, narrowing), offset)
            _line(axes, place, colour, width=2.4)


def _moved(ends: tuple[Place, Place], offset: float, narrowing: float = 1.0) -> tuple[Place, Place]:
    """Return a line beside another, in inches; at its end the offset is narrowed."""
    (x1, y1), (x2, y2) = ends
    length = dist(*ends) or 1.0
    right, down = -(y2 - y1) / length * offset, (x2 - x1) / length * offset
    return (x1 + right, y1 + down), (x2 + narrowing * right, y2 + narrowing * down)


def _line(
    axes: Axes, ends: tuple[Place, Place], colour: str, width: float = 1.0, dashed: bool = False
) -> None:
    style = (0, (3, 3)) if dashed else "-"
    axes.plot(*zip(*ends, strict=True), color=colour, linewidth=width, linestyle=style, zorder=2)


def edge(quantum: bool, eavesdrops: bool) -> str:
    """Return the colour of a node's box."""
    return BAD if eavesdrops else QUANTUM if quantum else INK


def node(axes: Axes, place: Place, name: str, below: str, colour: str) -> None:
    """Draw a box with a name, and a smaller line below it."""
    (x, y), (width, height) = place, NODE_INCHES
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
