"""Whether news can outrun light, and by how much at worst."""

from typing import Any, NamedTuple

from programs.shortest_paths import Distances, shortest
from topologies.links.copper_link import least_delay_s
from topologies.system.runs.runtime import Runtime


class Early(NamedTuple):
    """News that can come before light could."""

    origin: str
    receiver: str
    early_s: float  # of the network

    def to_dict(self) -> dict[str, Any]:
        return {"from": self.origin, "to": self.receiver, "early_s": self.early_s}


def worst(network: Runtime) -> Early | None:
    """Return what outruns light most, in a network that has been built; None if nothing can.

    News goes along the copper, also to the controller and from there to the switches. A lead of
    light that is less than any packet takes here is not news that is early.
    """
    light, news = ways_of_light(network), ways_of_news(network)
    least_s = least_delay_s(network.time)
    early: list[Early] = []
    for origin in (node for node in light if node not in network.switches):
        by_light, by_news = shortest(light, origin), shortest(news, origin)
        early += [
            Early(origin, receiver, light_s - by_news[receiver])
            for receiver, light_s in by_light.items()
            if receiver != origin
            if receiver in by_news
            if light_s - by_news[receiver] >= least_s
        ]
    return max(early, key=lambda each: each.early_s, default=None)


def ways_of_light(network: Runtime) -> Distances:
    """Return the fastest fibre between neighbours."""
    distances: Distances = {}
    for fiber in network.fibers:
        _join(distances, fiber.a.node, fiber.b.node, fiber.delay_s)
    return distances


def ways_of_news(network: Runtime) -> Distances:
    """Return the copper between neighbours, also that to the controller."""
    distances: Distances = {}
    for link, delay_s in network.copper.items():
        one, other = sorted(link)
        _join(distances, one, other, delay_s)
    return distances


def _join(distances: Distances, one: str, other: str, delay_s: float) -> None:
    for near, far in ((one, other), (other, one)):
        distances_here = distances.setdefault(near, {})
        distances_here[far] = min(delay_s, distances_here.get(far, delay_s))
