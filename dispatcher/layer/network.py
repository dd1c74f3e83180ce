"""Fibres and quantum switches, and which port light comes to from which."""

from collections import defaultdict
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

from dispatcher.fiber import fiber_noise
from dispatcher.fiber.channels import ChannelCrosstalk, Traffic
from dispatcher.fiber.noise import NoiseModel
from dispatcher.refusal import denied, not_found
from dispatcher.switch.optical_switch import Channel, OpticalSwitch
from wire.config import BadConfig, Fiber, FiberEnd, QuantumSwitch
from wire.parameters.fiber import FiberOptics
from wire.parameters.physics import BadParameter
from wire.parameters.switch import Kind


class Part(NamedTuple):
    """A part of a switch, and the inner ports that lead to it."""

    switch: str
    ports: list[str]


@dataclass(frozen=True)
class Line:
    """A fibre as seen from one of its ends."""

    near: FiberEnd
    far: FiberEnd
    fiber: Fiber
    noise: dict[str, NoiseModel]
    traffic: Traffic | None = None  # of its channel, if neighbouring ones are to know of it

    def passes(self, frequency_mhz: int) -> bool:
        fixed_mhz = self.fiber.fixed_mhz
        return fixed_mhz is None or 2 * abs(frequency_mhz - fixed_mhz) < self.fiber.grid_mhz

    @cached_property
    def delay_ps(self) -> float:
        return self.fiber.delay_s * 1e12


class Network:
    """Where each port's fibre leads to."""

    def __init__(
        self,
        fibers: list[Fiber],
        switches: list[QuantumSwitch],
        entrance: Callable[[FiberEnd], NoiseModel | None] = lambda _end: None,
    ) -> None:
        """Lay the fibres, to entrances at their ends; raise BadConfig or BadParameter."""
        self._entrance = entrance
        self._lines: dict[FiberEnd, Line] = {}
        # By fibre and by where its light comes out: what is in each of its channels.
        self._strands: defaultdict[tuple[str, str], dict[int, Traffic]] = defaultdict(dict)
        named = {switch.name: switch for switch in switches}
        for fiber in fibers:
            self._lay(fiber, named)
        # Of switches, by the name of their node here.
        self.parts = {kind: dict[str, Part]() for kind in Kind}
        self.analysers, self.memories = self.parts[Kind.ANALYSER], self.parts[Kind.MEMORY]
        for switch in switches:
            self._lay_parts(switch, named)
        self.switches = {switch.name: self._switch(switch) for switch in switches}

    @property
    def has_crosstalk(self) -> bool:
        return bool(self._strands)

    def line(self, end: FiberEnd) -> Line | None:
        return self._lines.get(end)

    def between(self, one: str, other: str) -> list[Line]:
        """Return the fibres that join two nodes, each in both directions; refuse if none does."""
        ends = {one, other}
        lines = [line for line in self._lines.values() if {line.near.node, line.far.node} == ends]
        if not lines:
            near = sorted(line.far.node for line in self._lines.values() if line.near.node == one)
            neighbours = ", ".join(dict.fromkeys(near)) or "nothing"
            raise not_found(f"no fibre joins {one} and {other}; {one} is joined to {neighbours}")
        return lines

    def require_port(self, node: str, port: str) -> FiberEnd:
        end = FiberEnd(node, port)
        if end in self._lines:
            return end
        ports = ", ".join(sorted(e.port for e in self._lines if e.node == node)) or "none"
        owners = [e.node for e in self._lines if e.port == port and e.node not in self.switches]
        if owners:
            raise denied(f"port {port} belongs to {owners[0]}; {node} has {ports}")
        raise not_found(f"{node} has no port {port} with a fibre; it has {ports}")

    def power_at(self, end: FiberEnd) -> float:
        """Return the power (dBm) that comes out of the fibre at a port that has one.

        It is that of the supervisory light, which a host launches with 0 dBm.
        """
        line = self._lines[end]
        switch = self.switches.get(line.far.node)
        launched_dbm = switch.ports[int(line.far.port)].power_dbm.now if switch else 0.0
        return launched_dbm - line.fiber.loss_db

    def _lay(self, fiber: Fiber, switches: Mapping[str, QuantumSwitch]) -> None:
        try:
            fiber.check(f"fiber {_name(fiber.a)} to {_name(fiber.b)}")
        except BadParameter as error:
            raise BadConfig(str(error)) from error
        noise = fiber_noise.models(fiber)
        for near, far in ((fiber.a, fiber.b), (fiber.b, fiber.a)):
            if near in self._lines:
                raise BadConfig(f"two fibres end in port {near.port} of {near.node}")
            if near.node in switches and not near.port.isdecimal():
                raise BadConfig(f"port {near.port} of switch {near.node} is not a port number")
            near_switch = switches.get(near.node)
            switched = {} if near_switch is None else fiber_noise.of_switch(near_switch)
            self._lines[near] = self._line(near, far, fiber, switched | noise)

    def _lay_parts(self, switch: QuantumSwitch, switches: Mapping[str, QuantumSwitch]) -> None:
        """Let light that leaves by an inner port come to its part, which is a node."""
        for port, inner in switch.inner_ports.items():
            node = inner.node(switch.name)
            part = self.parts[inner.kind].setdefault(node, Part(switch.name, []))
            part.ports.append(str(port))
            near, far = FiberEnd(switch.name, str(port)), FiberEnd(node, str(port))
            self._lay(Fiber.joining(near, far, FiberOptics(length_km=0.0)), switches)

    def _line(
        self, near: FiberEnd, far: FiberEnd, fiber: Fiber, noise: dict[str, NoiseModel]
    ) -> Line:
        """Return a fibre in one direction; its channels' crosstalk is where light comes out."""
        if (entrance := self._entrance(far)) is not None:
            noise = {**noise, type(entrance).__name__: entrance}
        if fiber.channels == 1 or fiber.channel_crosstalk_db is None:
            return Line(near, far, fiber, noise)
        strand = self._strands[fiber.strand, far.node]
        traffic = strand[fiber.channel] = Traffic()
        crosstalk = ChannelCrosstalk(fiber, strand)
        return Line(near, far, fiber, {**noise, type(crosstalk).__name__: crosstalk}, traffic)

    def _switch(self, config: QuantumSwitch) -> OpticalSwitch:
        config.check()
        lines = {end: line for end, line in self._lines.items() if end.node == config.name}
        by_port = {int(end.port): line for end, line in lines.items()}
        config.check_ports(by_port)
        return OpticalSwitch(config, {port: channel_of(line) for port, line in by_port.items()})


def channel_of(line: Line) -> Channel | None:
    fixed_mhz = line.fiber.fixed_mhz
    return None if fixed_mhz is None else Channel(fixed_mhz, line.fiber.grid_mhz)


def _name(end: FiberEnd) -> str:
    return f"{end.node} port {end.port}"
