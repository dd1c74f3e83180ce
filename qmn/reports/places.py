"""The places of a network's nodes in its drawing: columns from left to right.

Classical switches, hosts, then quantum switches. A line of switches is one column; a ring has
its far side in a second one; so has a fabric of two stages, leaves in the first.
"""

from collections.abc import Mapping

from qmn.results.network_facts import NetworkFacts

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
    own = [height for name, height in heights.items() if host in neighbours[name]]
    return sum(own) / len(own) if own else len(heights)


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
