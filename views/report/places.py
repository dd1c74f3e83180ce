"""The places of a network's nodes in its drawing: on its map, or in columns from left to right.

Classical switches, hosts, then quantum switches. A line of switches is one column; a ring has
its far side in a second one; so has a fabric of two stages, leaves in the first.
"""

from collections.abc import Mapping, Sequence
from itertools import combinations
from math import cos, radians

from wire.results.run_result import NetworkFacts

WIDTH_INCHES, NODE_INCHES = 8.6, (0.95, 0.36)  # of a drawing; of a node's box
MARGIN_INCHES, LEAST_HEIGHT_INCHES, MOST_HEIGHT_INCHES = 0.6, 3.6, 9.0  # of a map
BETWEEN_INCHES = 0.12  # boxes of a map, at least
ROUNDS = 300  # in which boxes that overlap make room
Place = tuple[float, float]
Positions = Mapping[str, Place]  # degrees east and north
Neighbours = Mapping[str, set[str]]


def columns(facts: NetworkFacts) -> list[list[str]]:
    """Return the nodes of each column from top to bottom, hosts about as high as their switch."""
    quantum = [switch.name for switch in facts.switches]
    joined = [(fiber.a.node, fiber.b.node) for fiber in facts.fibers]
    joined += [(two, one) for one, two in joined]
    neighbours = {name: {two for one, two in joined if one == name} for name in quantum}
    with_host = {name for name in quantum if neighbours[name] & facts.addresses.keys()}
    between = {name: neighbours[name] & set(quantum) for name in quantum}
    near, far = _switch_columns(between, with_host)

    heights = {name: number for number, name in enumerate([*near, *far])}
    hosts = sorted(facts.addresses, key=lambda host: _height(host, heights, neighbours))
    copper = {name for link in facts.copper for name in (link[0], link[2])}
    classical = sorted(copper - facts.addresses.keys() - set(quantum))
    return [column for column in (classical, hosts, near, far) if column]


def _height(host: str, heights: Mapping[str, int], neighbours: Neighbours) -> float:
    """Return about how far down a host belongs: in the middle of the switches it has fibres to."""
    levels = [height for name, height in heights.items() if host in neighbours[name]]
    return sum(levels) / len(levels) if levels else len(heights)


def _switch_columns(neighbours: Neighbours, with_host: set[str]) -> tuple[list[str], list[str]]:
    if any(len(names) > 2 for names in neighbours.values()):
        return _stages(neighbours, with_host)
    order = _walk(neighbours)
    if not all(len(names) == 2 for names in neighbours.values()):
        return order, []
    last_with_host = max((order.index(name) for name in with_host), default=0)
    count = max(last_with_host + 1, (len(order) + 1) // 2)
    return order[:count], order[: count - 1 : -1]


def _walk(neighbours: Neighbours) -> list[str]:
    """Return the switches of lines and rings in the order in which light meets them."""
    order: dict[str, None] = {}
    ends = [name for name, names in neighbours.items() if len(names) < 2]
    for begin in [*ends, *neighbours]:
        place: str | None = begin
        while place is not None and place not in order:
            order[place] = None
            place = next((n for n in neighbours if n in neighbours[place] - order.keys()), None)
    return list(order)


def _stages(neighbours: Neighbours, with_host: set[str]) -> tuple[list[str], list[str]]:
    """Return the switches that are an even number of fibres from one with a host, and the rest."""
    stage = dict.fromkeys(with_host, 0)
    waiting = list(stage)
    for name in waiting:  # grows
        for other in neighbours[name] - stage.keys():
            stage[other] = stage[name] + 1
            waiting.append(other)
    near = [name for name in neighbours if stage.get(name, 0) % 2 == 0]
    return near, [name for name in neighbours if name not in near]


def of_nodes(facts: NetworkFacts) -> dict[str, Place]:
    """Return the position of each node that has light; of one that has none, its neighbour's."""
    places = dict(facts.positions)
    for fiber in facts.fibers:
        for near, far in ((fiber.a.node, fiber.b.node), (fiber.b.node, fiber.a.node)):
            if near not in places and far in facts.positions:
                places[near] = facts.positions[far]
    joined = {end.node for fiber in facts.fibers for end in (fiber.a, fiber.b)}
    return {name: place for name, place in places.items() if name in joined}


def on_paper(positions: Sequence[Place]) -> list[Place]:
    """Return positions in inches from the top left: as on a map, boxes clear of each other."""
    middle = sum(north for _, north in positions) / len(positions)
    # A degree to the east is shorter where it is far north; on no sphere, nothing is that far.
    shrink = cos(radians(middle)) if abs(middle) < 90 else 1.0
    plain = [(east * shrink, -north) for east, north in positions]
    left, top = (min(values) for values in zip(*plain, strict=True))
    wide, high = (max(values) - min(values) for values in zip(*plain, strict=True))
    space_x, most_y = WIDTH_INCHES - 2 * MARGIN_INCHES, MOST_HEIGHT_INCHES - 2 * MARGIN_INCHES
    scale_x = space_x / wide if wide else 0.0
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
