"""Controllers as one switch reaches them: ours on the management network."""

from dataclasses import dataclass
from typing import Any

from mininet.node import Controller


@dataclass(frozen=True)
class Reached:
    """A controller as one switch reaches it: what Mininet asks of a controller."""

    name: str
    address: str
    port: int
    protocol: str = "tcp"

    def IP(self) -> str:  # noqa: N802 (Mininet's name)
        return self.address


class ManagedController(Controller):
    """A controller that switches reach on the management network."""

    addresses: dict[str, str]  # by switch


def as_reached(controller: Controller, switch: str) -> Any:
    """Return a controller as a switch reaches it: ours is on the management network."""
    if not isinstance(controller, ManagedController):
        return controller
    address = controller.addresses[switch]
    return Reached(controller.name, address, controller.port, controller.protocol)
