"""The drawing of a network on a map: a box for each place, fibres between the places."""

from collections.abc import Mapping, Sequence
from itertools import combinations
from math import cos, radians

from qmn.reports import drawing
from qmn.reports.labels import NODE_INCHES, Labels, Place
from qmn.reports.light_paths import LightPath
from qmn.reports.network_diagram import WIDTH_INCHES, bundle, described, lit, node, used
from qmn.results.network_facts import NetworkFacts
from wire.parameters.fiber import Fiber

MARGIN_INCHES, LEAST_HEIGHT_INCHES, MOST_HEIGHT_INCHES = 0.6, 3.6, 9.0
BETWEEN_INCHES = 0.12  # boxes, at least
LINE_LETTERS = 20  # of a box
ROUNDS = 300  # in which boxes that overlap make room
Positions = Mapping[str, Place]  # degrees east and north


@drawing.styled
def map_diagram(facts: NetworkFacts, paths: Sequence[LightPath]) -> str:
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
        bundle(axes, ends, fibers, paths, 1.0)
        labels.add(ends, described(fibers), needed=used(fibers, names))
    labels.write()
    for at, place in places.items():
        here = [name for name, own in nodes.items() if own == at]
        hosts = [name for name in here if name in facts.addresses]
        first, *others = [*hosts, *(name for name in here if name not in hosts)]
        node(axes, place, first, in_a_line(others), not hosts)
    return drawing.svg(made, "the network on its map: places, and fibres with length and loss")


def in_a_line(names: Sequence[str]) -> str:
    """Return names as a box has room for them."""
    shown = ", ".join(names)
    if len(shown) <= LINE_LETTERS:
        return shown
    kept = next(
        n for n in range(len(names), -1, -1) if len(", ".join(names[:n])) <= LINE_LETTERS - 9
    )
    return ", ".join([*names[:kept], f"{len(names) - kept} more"])


def of_nodes(facts: NetworkFacts) -> dict[str, Place]:
    """Return the position of each node that has light; of one that has none, its neighbour's."""
    known = dict(facts.positions)
    for fiber in facts.fibers:
        for near, far in ((fiber.a.node, fiber.b.node), (fiber.b.node, fiber.a.node)):
            if near not in known and far in facts.positions:
                known[near] = facts.positions[far]
    joined = {end.node for fiber in facts.fibers for end in (fiber.a, fiber.b)}
    return {name: place for name, place in known.items() if name in joined}


def on_paper(positions: Sequence[Place]) -> list[Place]:
    """Return positions in inches from the top left: as on a map, boxes clear of each other."""
    middle = sum(north for _, north in positions) / len(positions)
    # A degree to the east is shorter where it is far north; on no sphere, nothing is that far.
    shrink = cos(radians(middle)) if abs(middle) < 90 else 1.0
    plain = [(east * shrink, -north) for east, north in positions]
    left, top = (min(values) for values in zip(*plain, strict=True))
    wide, high = (max(values) - min(values) for values in zip(*plain, strict=True))
    room_x, most_y = WIDTH_INCHES - 2 * MARGIN_INCHES, MOST_HEIGHT_INCHES - 2 * MARGIN_INCHES
    scale_x = room_x / wide if wide else 0.0
    least_y = LEAST_HEIGHT_INCHES - 2 * MARGIN_INCHES
    tall = min(max(high * scale_x, least_y), most_y) if high else 0.0
    scale_y = tall / high if high else 0.0
    return _apart(
        [
            (MARGIN_INCHES + (x - left) * scale_x, MARGIN_INCHES + (y - top) * scale_y)
            for x, y in plain
        ]
    )


def _apart(places: list[Place]) -> list[Place]:
    """Return the places, moved until no boxes overlap, or as little as there is room for."""
    width, height = (size + BETWEEN_INCHES for size in NODE_INCHES)
    moved = [list(place) for place in places]
    for _ in range(ROUNDS):
        overlap = False
        for one, two in combinations(moved, 2):
            across, down = width - abs(one[0] - two[0]), height - abs(one[1] - two[1])
            if across <= 0 or down <= 0:
                continue
            overlap = True
            axis, by = (1, down) if down / height <= across / width else (0, across)
            sign = 1 if two[axis] >= one[axis] else -1
            one[axis] -= sign * by / 2
            two[axis] += sign * by / 2
        for place in moved:
            place[0] = min(max(place[0], MARGIN_INCHES), WIDTH_INCHES - MARGIN_INCHES)
        if not overlap:
            break
    top = min(y for _x, y in moved) - MARGIN_INCHES
    return [(x, y - top) for x, y in moved]
