"""Fibres and light paths of a running network, hop by hop, as scripts and `qmn cli` see them."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import reduce
from operator import xor
from typing import Any

from qmn.scripting.tables import Row, Tabular, row_of
from wire.dispatcher_pb2 import SwitchCondition, SwitchStatisticsReply
from wire.outcomes import Pauli
from wire.parameters.fiber import Fiber, FiberEnd

Statistics = Mapping[str, SwitchStatisticsReply]
Conditions = Mapping[str, SwitchCondition]


@dataclass(frozen=True)
class Hop:
    """A fibre, or a switch, that light passes."""

    what: str  # "fibre", or the name of the switch
    begin: str  # port, as "alice-q0" or "q1:3"
    end: str
    length_km: float  # of a switch 0
    loss_db: float
    rotation: Pauli  # known, and undone by the receiver


@dataclass(frozen=True)
class LightPath(Tabular):
    """The way of one photon of each pair in a session; as a table, a row for each hop."""

    session: str  # 16 hexadecimal digits
    hops: tuple[Hop, ...]

    @property
    def loss_db(self) -> float:
        """Loss from end to end."""
        return sum(hop.loss_db for hop in self.hops)

    @property
    def rotation(self) -> Pauli:
        """Known rotation from end to end."""
        return Pauli(reduce(xor, (hop.rotation for hop in self.hops), Pauli.I))

    def rows(self) -> Sequence[Row]:
        """Return a row for each hop."""
        return [
            {"session": self.session, **row_of(hop), "rotation": hop.rotation.name}
            for hop in self.hops
        ]


@dataclass(frozen=True)
class FiberState(Tabular):
    """A fibre with what its supervisory light loses now, and photons counted at its switches."""

    a: str  # port, as "alice-q0" or "q1:3"
    b: str
    length_km: float
    loss_db: float
    up: bool | None  # None: no controller says
    photons_to_a: int | None  # None: nobody counts
    photons_to_b: int | None
    lost_in_switches: int | None  # of those that came out of this fibre


def port_name(end: FiberEnd) -> str:
    """Return a port as a person names it."""
    return f"{end.node}:{end.port}" if end.port.isdecimal() else end.port


def light_path(
    path: Mapping[str, Any],
    fibers: Iterable[Fiber],
    names: Mapping[int, str],
    conditions: Conditions,
) -> LightPath:
    """Return a path of the controller's answer, hop by hop; names are those of datapath ids."""
    fiber_at = {end: fiber for fiber in fibers for end in (fiber.a, fiber.b)}
    begin = next(end for end in fiber_at if end.port == path["begin"])
    hops = []
    for hop in path["hops"]:
        switch = names[int(hop["dpid"], 16)]
        hops.append(_along(fiber_at[begin], begin))
        hops.append(_across(switch, hop["in_port"], hop["out_port"], conditions[switch]))
        begin = FiberEnd(switch, str(hop["out_port"]))
    return LightPath(path["session"], (*hops, _along(fiber_at[begin], begin)))


def _along(fiber: Fiber, begin: FiberEnd) -> Hop:
    end = fiber.b if begin == fiber.a else fiber.a
    return Hop("fibre", port_name(begin), port_name(end), fiber.length_km, fiber.loss_db, Pauli.I)


def _across(switch: str, in_port: int, out_port: int, condition: SwitchCondition) -> Hop:
    paths = [
        path for path in condition.paths if (path.in_port, path.out_port) == (in_port, out_port)
    ]
    optics = paths[0] if paths else condition
    start, end = f"{switch}:{in_port}", f"{switch}:{out_port}"
    return Hop(switch, start, end, 0.0, optics.loss_db, Pauli(optics.rotation))


def fiber_state(
    fiber: Fiber, statistics: Statistics, up: Mapping[tuple[str, int], bool]
) -> FiberState:
    """Return how a fibre is; `up` says it of switch ports."""
    ports = {
        end: port
        for end in (fiber.a, fiber.b)
        for port in (statistics[end.node].ports if end.node in statistics else ())
        if end.port == str(port.port)
    }
    at_a, at_b = ports.get(fiber.a), ports.get(fiber.b)
    loss_db = fiber.loss_db
    if near := at_b or at_a:
        far = at_a if near is at_b else at_b
        loss_db = (far.power_dbm if far else 0.0) - near.rx_power_dbm  # a host launches 0 dBm
    states = [up[end.node, int(end.port)] for end in ports if (end.node, int(end.port)) in up]
    return FiberState(
        port_name(fiber.a),
        port_name(fiber.b),
        fiber.length_km,
        loss_db,
        all(states) if states else None,
        photons_to_a=at_a.photons_in if at_a else at_b.photons_out if at_b else None,
        photons_to_b=at_b.photons_in if at_b else at_a.photons_out if at_a else None,
        lost_in_switches=sum(port.photons_lost for port in ports.values()) if ports else None,
    )
