"""The places of a network's nodes on the page, and what the page needs to know of its parts."""

from math import cos, pi, sin
from typing import Any

from hosts.middleware.session.errors import REMEDIES
from views.report.light_paths import fiber_name
from views.report.places import Place, columns, of_nodes, on_paper
from wire.results.run_result import NetworkFacts

WIDTH = 1000.0  # of the drawing, in its own units
ROW = 90.0
MOST_IN_COLUMN = 24  # with more, nodes are placed by who is joined to whom
PER_INCH = 120.0
BETWEEN = 100.0  # hosts around a switch
SPRING_ROUNDS = 60
QUANTUM, CLASSICAL, HOST = "quantum switch", "classical switch", "host"


def described(facts: NetworkFacts) -> dict[str, Any]:
    """Return nodes with their places, fibres and copper, as JSON takes it."""
    quantum = {switch.name for switch in facts.switches}
    places = placed(facts)

    def kind(name: str) -> str:
        return HOST if name in facts.addresses else QUANTUM if name in quantum else CLASSICAL

    copper = {tuple(sorted((link[0], link[2]))) for link in facts.copper}
    return {
        "nodes": [
            {"name": name, "kind": kind(name), "x": x, "y": y, "ip": facts.addresses.get(name, "")}
            for name, (x, y) in places.items()
        ],
        "fibers": [
            {
                "name": fiber_name(fiber),
                "ends": [[fiber.a.node, fiber.a.port], [fiber.b.node, fiber.b.port]],
                "km": fiber.length_km,
                "loss_db": fiber.loss_db,
            }
            for fiber in facts.fibers
        ],
        "parts": {  # by the ports of switches that lead to them
            f"{switch.name}:{number}": port.node(switch.name)
            for switch in facts.switches
            for number, port in switch.inner_ports.items()
        },
        "copper": [list(ends) for ends in sorted(copper) if set(ends) <= places.keys()],
        "source": facts.source,
        # As the controller's record has them: switches by datapath ids, hosts by addresses.
        "names": {str(dpid): name for name, dpid in facts.datapath_ids.items()}
        | {address: host for host, address in facts.addresses.items()},
        "columns": in_columns(facts),
        "reasons": {reason.name: text.split(";")[0] for reason, text in REMEDIES.items()},
    }


def placed(facts: NetworkFacts) -> dict[str, Place]:
    """Return where each node is: on its map, in columns, or near to its neighbours."""
    if facts.positions:
        return _on_map(facts)
    if not in_columns(facts):
        return _by_neighbours(facts)
    filled = columns(facts)
    height = ROW * max(map(len, filled))
    return {
        name: (WIDTH * (column + 0.5) / len(filled), height * (row + 0.5) / len(names))
        for column, names in enumerate(filled)
        for row, name in enumerate(names)
    }


def in_columns(facts: NetworkFacts) -> bool:
    """Return whether nodes stand in columns, and not where they are on a map, or by who is near."""
    return not facts.positions and max(map(len, columns(facts))) <= MOST_IN_COLUMN


def _on_map(facts: NetworkFacts) -> dict[str, Place]:
    """Return places on the map; nodes at one place stand around it."""
    nodes = of_nodes(facts)
    boxes = sorted(set(nodes.values()))
    paper = dict(zip(boxes, on_paper(boxes), strict=True))
    here: dict[Place, int] = {}
    places = {}
    for name in sorted(nodes, key=lambda name: name in facts.addresses):
        at = nodes[name]
        number = here[at] = here.get(at, -1) + 1
        x, y = paper[at]
        places[name] = (PER_INCH * x + 34.0 * number, PER_INCH * y + 26.0 * number)
    return places


def _by_neighbours(facts: NetworkFacts) -> dict[str, Place]:
    """Return switches where springs between joined ones would pull them, hosts around their own."""
    import networkx as nx  # a second's loading, which few networks need

    quantum = [switch.name for switch in facts.switches]
    graph = nx.Graph()
    graph.add_nodes_from(quantum)
    near: dict[str, list[str]] = {name: [] for name in quantum}
    first: dict[str, str] = {}  # neighbour of each host: a switch, or else another host
    for fiber in facts.fibers:
        one, two = fiber.a.node, fiber.b.node
        if one in near and two in near:
            graph.add_edge(one, two)
            continue
        for host, other in ((one, two), (two, one)):
            if host in facts.addresses and host not in first:
                first[host] = other
                near.setdefault(other, []).append(host)
    alone = [host for host in facts.addresses if host not in first]
    around = max((_radius(len(hosts)) for hosts in near.values()), default=0.0)
    size = (around + ROW) * len(graph) ** 0.5
    middles = nx.spring_layout(graph, seed=1, iterations=SPRING_ROUNDS, scale=size)
    places: dict[str, Place] = {name: (float(x), float(y)) for name, (x, y) in middles.items()}
    for name, hosts in near.items():
        x, y = places.setdefault(name, (size + around, 0.0))
        for number, host in enumerate(hosts):
            angle, radius = 2 * pi * number / len(hosts), _radius(len(hosts))
            places.setdefault(host, (x + radius * cos(angle), y + radius * sin(angle)))
    for number, host in enumerate(alone):
        places[host] = (-size - around, ROW * number)
    return places


def _radius(hosts: int) -> float:
    """Return how far hosts are from their switch so that there is room between them."""
    return max(WIDTH / 6, BETWEEN * hosts / (2 * pi))
