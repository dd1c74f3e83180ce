"""Fibres and quantum switches, and which port light comes to from which."""

from dataclasses import dataclass

from dispatcher.noise import Depolarizing, Loss, NoiseModel
from dispatcher.optical_switch import OpticalSwitch
from dispatcher.refusal import denied, not_found
from wire import switch_check
from wire.config import BadConfig, Fiber, FiberEnd, QuantumSwitch

SPEED_IN_FIBER_M_PER_S = 2.04e8
MAX_LENGTH_KM = 100_000


@dataclass(frozen=True)
class Line:
    """A fibre as seen from one of its ends."""

    far: FiberEnd
    delay_ns: int
    loss_db: float
    noise: tuple[NoiseModel, ...]


class Network:
    """Where each port's fibre leads to."""

    def __init__(self, fibers: list[Fiber], switches: list[QuantumSwitch]) -> None:
        """Lay the fibres; raise BadConfig where they cannot be."""
        self._lines: dict[FiberEnd, Line] = {}
        names = {switch.name for switch in switches}
        for fiber in fibers:
            self._lay(fiber, names)
        self.switches = {switch.name: self._switch(switch) for switch in switches}

    def line(self, end: FiberEnd) -> Line | None:
        """Return the fibre that begins at a port, None if there is none."""
        return self._lines.get(end)

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
        return launched_dbm - line.loss_db

    def _lay(self, fiber: Fiber, switches: set[str]) -> None:
        _check(fiber)
        delay_ns = round(fiber.length_km * 1e3 / SPEED_IN_FIBER_M_PER_S * 1e9)
        loss_db = fiber.loss_db_per_km * fiber.length_km
        noise = (Loss(loss_db), Depolarizing(fiber.depolarizing))
        for near, far in ((fiber.a, fiber.b), (fiber.b, fiber.a)):
            if near in self._lines:
                raise BadConfig(f"two fibres end in port {near.port} of {near.node}")
            if near.node in switches and not near.port.isdecimal():
                raise BadConfig(f"port {near.port} of switch {near.node} is not a port number")
            self._lines[near] = Line(far, delay_ns, loss_db, noise)

    def _switch(self, config: QuantumSwitch) -> OpticalSwitch:
        switch_check.check(config)
        ports = {int(end.port) for end in self._lines if end.node == config.name}
        switch_check.check_ports(config, ports)
        return OpticalSwitch(config, ports)


def _check(fiber: Fiber) -> None:
    if not 0 <= fiber.length_km <= MAX_LENGTH_KM or not fiber.loss_db_per_km >= 0:
        raise BadConfig(f"{fiber}: length must be 0 to {MAX_LENGTH_KM} km, loss at least 0 dB/km")
    if not 0 <= fiber.depolarizing <= 1:
        raise BadConfig(f"{fiber}: depolarizing is a probability, 0 to 1")
