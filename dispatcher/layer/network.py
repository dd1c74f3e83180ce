"""Fibres and quantum switches, and which port light comes to from which."""

from dataclasses import dataclass

from dispatcher.fiber import fiber_noise
from dispatcher.fiber.noise import NoiseModel
from dispatcher.refusal import denied, not_found
from dispatcher.switch.optical_switch import OpticalSwitch
from wire.config import BadConfig, Fiber, FiberEnd, QuantumSwitch
from wire.parameters.physics import BadParameter


@dataclass(frozen=True)
class Line:
    """A fibre as seen from one of its ends."""

    near: FiberEnd
    far: FiberEnd
    fiber: Fiber
    noise: dict[str, NoiseModel]

    @property
    def delay_ns(self) -> int:
        """How long light takes to the far end."""
        return round(self.fiber.delay_s * 1e9)


class Network:
    """Where each port's fibre leads to."""

    def __init__(self, fibers: list[Fiber], switches: list[QuantumSwitch]) -> None:
        """Lay the fibres; raise BadConfig or BadParameter for what cannot be."""
        self._lines: dict[FiberEnd, Line] = {}
        names = {switch.name for switch in switches}
        for fiber in fibers:
            self._lay(fiber, names)
        self.switches = {switch.name: self._switch(switch) for switch in switches}

    def line(self, end: FiberEnd) -> Line | None:
        """Return the fibre that begins at a port, None if there is none."""
        return self._lines.get(end)

    def between(self, one: str, other: str) -> list[Line]:
        """Return the fibres that join two nodes, each in both directions; refuse if none does."""
        ends = {one, other}
        found = [line for line in self._lines.values() if {line.near.node, line.far.node} == ends]
        if not found:
            near = sorted(line.far.node for line in self._lines.values() if line.near.node == one)
            known = ", ".join(dict.fromkeys(near)) or "nothing"
            raise not_found(f"no fibre joins {one} and {other}; {one} is joined to {known}")
        return found

    def require_port(self, node: str, port: str) -> FiberEnd:
        """Return the port of this name if it is the node's own."""
        end = FiberEnd(node, port)
        if end in self._lines:
            return end
        own = ", ".join(sorted(e.port for e in self._lines if e.node == node)) or "none"
        owners = [e.node for e in self._lines if e.port == port and e.node not in self.switches]
        if owners:
            raise denied(f"port {port} belongs to {owners[0]}; {node} has {own}")
        raise not_found(f"{node} has no port {port} with a fibre; it has {own}")

    def power_at(self, end: FiberEnd) -> float:
        """Return the power (dBm) that comes out of the fibre at a port that has one.

        It is that of the supervisory light, which a host launches with 0 dBm.
        """
        line = self._lines[end]
        switch = self.switches.get(line.far.node)
        launched_dbm = switch.ports[int(line.far.port)].power_dbm.now if switch else 0.0
        return launched_dbm - line.fiber.loss_db

    def _lay(self, fiber: Fiber, switches: set[str]) -> None:
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
            self._lines[near] = Line(near, far, fiber, noise)

    def _switch(self, config: QuantumSwitch) -> OpticalSwitch:
        config.check()
        ports = {int(end.port) for end in self._lines if end.node == config.name}
        config.check_ports(ports)
        return OpticalSwitch(config, ports)


def _name(end: FiberEnd) -> str:
    return f"{end.node} port {end.port}"
