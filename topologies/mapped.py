"""A network on a map (s1, ed and copper as in sdc.py): at each place a quantum switch and a host.

  seattle            chicago          place     host, two fibres to its switch
     ||                 ||            q1, q2    switches, two fibres for each way of the map
     q1 =============== q2 == src     src       the pair source, at the centre

sudo PYTHONPATH=. mn --custom topologies/mapped.py --topo map,map=abilene
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from mininet.log import warn

from programs.shortest_paths import Distances, shortest
from topologies.catalogue.map_parts import spelling
from topologies.catalogue.maps import Map, Place, Position, positions, read_map
from topologies.fabric import FabricTopo, Mininet, controllers, findController
from topologies.links.copper_lengths import centre
from wire.parameters.physics import BellAnalyser, Device

__all__ = ["MapTopo", "Mininet", "controllers", "findController", "topos"]

HOST_FIBERS = 2
MOST_DELAY_KM = 20_000.0  # of the ideal delay line of hosts without a setting
SOURCE = "src"


class MapTopo(FabricTopo):
    """Hosts and pair sources where they are wanted; lengths as the map has them."""

    def build(
        self,
        map: str = "abilene",  # noqa: A002 (as the command line has it)
        fibers: int = 2,
        hosts_at: str = "",
        sources_at: str = "",
        **fiber: Any,
    ) -> None:
        """Lay copper and fibre; raise BadMap, or ValueError for lengths, which the map says.

        `hosts_at` and `sources_at` are places, with commas. Without, each place has a host, and the
        place from which the farthest is nearest has the pair source. Each host has its pairs from
        the nearest source.
        """
        if "length_km" in fiber:
            raise ValueError(
                "the map says how long fibres are: leave length_km out, or say of which"
            )
        read = read_map(map)
        if read.unused:
            warn(f"map {read.name}: not used here: {', '.join(read.unused)}\n")
        self.places = {spelling(place.called): place.name for place in read.places}
        places = chosen(read, hosts_at) or read.places
        self.set_up(addresses=len(read.places) * 2 + 2, **fiber)
        self._device = waiting_for_the_other_half(self._device)
        self.add_dispatcher(self.next_address())
        names = self.add_quantum_switches(len(read.places))
        switches = {place.name: q for place, q in zip(read.places, names, strict=True)}
        for link in read.links:
            lengths = {"length_km": link.length_km}
            if link.loss_db_per_km is not None and "loss_db_per_km" not in fiber:
                lengths["loss_db_per_km"] = link.loss_db_per_km
            self.join(switches[link.one], switches[link.other], int(fibers), **lengths)
        distances = distances_of(read)
        sources = self._add_sources(read, chosen(read, sources_at), distances, switches)
        self._add_hosts(places, sources, distances, switches)
        self.positions = positions_of(read, switches, sources)

    def _add_sources(
        self,
        read: Map,
        places: Sequence[Place],
        distances: Distances,
        switches: dict[str, str],
    ) -> dict[str, str]:
        at = [place.name for place in places]
        at = at or [str(centre(distances, [place.name for place in read.places]))]
        sources = {place: f"{SOURCE}{n if len(at) > 1 else ''}" for n, place in enumerate(at, 1)}
        for place, name in sources.items():
            self.add_host(name, self.next_address(), source=True)
            self.join(name, switches[place], HOST_FIBERS)
        return sources

    def _add_hosts(
        self,
        places: Sequence[Place],
        sources: dict[str, str],
        distances: Distances,
        switches: dict[str, str],
    ) -> None:
        for place in places:
            away = shortest(distances, place.name)
            nearest = min(sources, key=lambda source: away[source])
            name = place.name
            self.add_host(name, self.next_address(), pairs_from=sources[nearest])
            self.join(name, switches[name], HOST_FIBERS)


def waiting_for_the_other_half(device: Device) -> Device:
    """Return a host's device; one with the usual analyser keeps halves that come long before.

    On a map the ways of two halves differ by more than any usual delay line is long.
    """
    if device.analyser != BellAnalyser():
        return device
    endless = BellAnalyser(delay_line_db_per_km=0.0, delay_line_km=MOST_DELAY_KM)
    return replace(device, analyser=endless)


def distances_of(read: Map) -> Distances:
    """Return the shortest link between each two places that a link joins, in km."""
    distances: Distances = {place.name: {} for place in read.places}
    for link in read.links:
        for one, other in ((link.one, link.other), (link.other, link.one)):
            length_km = min(link.length_km, distances[one].get(other, link.length_km))
            distances[one][other] = length_km
    return distances


def chosen(read: Map, named: str) -> list[Place]:
    """Return the places that are named, with commas; raise BadMap for one that is not there."""
    return [read.place(name) for name in filter(None, named.split(","))]


def positions_of(
    read: Map, switches: dict[str, str], sources: dict[str, str]
) -> dict[str, Position]:
    """Return where each node is; on a map that does not say it, where it can be seen well."""
    by_node: dict[str, Position] = {}
    for place, position in positions(read).items():
        nodes = (place, switches[place], sources.get(place, ""))
        by_node |= dict.fromkeys(filter(None, nodes), position)
    return by_node


topos = {"map": MapTopo}
