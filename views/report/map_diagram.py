"""The drawing of a network on a map: a box for each place, fibres between the places."""

from collections.abc import Sequence

from views.report import drawing
from views.report.eavesdropped import NOBODY, Eavesdropped
from views.report.labels import Labels
from views.report.light_paths import LightPath
from views.report.network_diagram import bundle, described, edge, lit, node, used
from views.report.places import MARGIN_INCHES, WIDTH_INCHES, Place, of_nodes, on_paper
from wire.parameters.fiber import Fiber
from wire.results.run_result import NetworkFacts

LINE_LETTERS = 20  # of a box


@drawing.styled
def map_diagram(facts: NetworkFacts, paths: Sequence[LightPath], eve: Eavesdropped = NOBODY) -> str:
    """Draw places where they are, or a little beside; between them fibres, light in colour."""
    nodes = of_nodes(facts)
    boxes = sorted(set(nodes.values()))
    places = dict(zip(boxes, on_paper(boxes), strict=True))
    height = max(y for _x, y in places.values()) + MARGIN_INCHES
    made, axes = drawing.diagram(WIDTH_INCHES, height)
    bundles: dict[tuple[Place, Place], list[Fiber]] = {}
    for fiber in facts.fibers:
        one, two = sorted(places[nodes[end.node]] for end in (fiber.a, fiber.b))
        if one != two:
            bundles.setdefault((one, two), []).append(fiber)
    names = lit(paths)
    labels = Labels(axes, places.values())
    for ends, fibers in bundles.items():
        bundle(axes, ends, fibers, (paths, eve), 1.0)
        labels.add(ends, described(fibers), needed=used(fibers, names))
    labels.write()
    for at, place in places.items():
        here = [name for name, where in nodes.items() if where == at]
        hosts = [name for name in here if name in facts.addresses]
        first, *others = [*hosts, *(name for name in here if name not in hosts)]
        node(axes, place, first, in_a_line(others), edge(not hosts, not eve.nodes.isdisjoint(here)))
    return drawing.svg(made, "the network on its map: places, and fibres with length and loss")


def in_a_line(names: Sequence[str]) -> str:
    """Return names as a box has room for them."""
    shown = ", ".join(names)
    if len(shown) <= LINE_LETTERS:
        return shown
    most = next(
        n for n in range(len(names), -1, -1) if len(", ".join(names[:n])) <= LINE_LETTERS - 9
    )
    return ", ".join([*names[:most], f"{len(names) - most} more"])
