"""Where eavesdroppers sit: fibres that somebody measures, and hosts that measure others' light."""

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import NamedTuple

from views.report.light_paths import fiber_name
from wire.dispatcher_pb2 import Event
from wire.parameters.fiber import FiberEnd
from wire.results.run_result import NetworkFacts

TAPPED = "tapped "
TAKES = ("resend", "split")


class Eavesdropped(NamedTuple):
    """Hosts; fibres, each with the share of the photons that is measured in it, "" at a host."""

    nodes: frozenset[str]
    fibers: Mapping[str, str]


NOBODY = Eavesdropped(frozenset(), MappingProxyType({}))


def eavesdropped(network: NetworkFacts, events: Sequence[Event]) -> Eavesdropped:
    """Return who has eavesdropped at any time of the run."""
    nodes = frozenset(event.node for event in events if event.kind in TAKES)
    shares = {
        FiberEnd(event.node, event.port): event.detail.removeprefix(TAPPED)
        for event in events
        if event.kind == "tune" and event.detail.startswith(TAPPED) and event.detail != "tapped 0"
    }
    fibers: dict[str, str] = {}
    for fiber in network.fibers:
        ends = fiber.a, fiber.b
        if any(end in shares or end.node in nodes for end in ends):
            fibers[fiber_name(fiber)] = next((shares[end] for end in ends if end in shares), "")
    return Eavesdropped(nodes, fibers)
