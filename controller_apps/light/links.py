"""Fibres between switches, as heard from both their ends.

    port up --> asked quickly, then every LINK_PERIOD_S
    heard at both ends --> a link --port down, switch gone, not heard for LINK_EXPIRY_S--> none

No socket, no clock: `now` is in seconds of one steady clock.
"""

from dataclasses import dataclass, field

from controller_apps.light.optics import SwitchPort
from controller_apps.light.paths import Network
from controller_apps.timeouts import LINK_EXPIRY_S, LINK_FAST_PERIOD_S, LINK_PERIOD_S

FAST_TIMES = 10  # while the network starts (802.1AB fast start)


@dataclass
class _Port:
    due: float
    sent: int = 0


@dataclass
class Links:
    """When each fibre port speaks next, and what was last heard where."""

    network: Network
    _ports: dict[SwitchPort, _Port] = field(default_factory=dict)
    _heard: dict[SwitchPort, tuple[SwitchPort, float]] = field(default_factory=dict)

    def port_up(self, at: SwitchPort, now: float) -> None:
        """Let a port speak, quickly at first."""
        self._ports[at] = _Port(now)

    def port_down(self, at: SwitchPort) -> None:
        """Let a port be silent, and forget what was heard there."""
        self._ports.pop(at, None)
        self._heard.pop(at, None)
        self.network.remove_link(at)

    def switch_left(self, dpid: int) -> None:
        """Let all ports of a switch be silent."""
        ends = {at for at in (*self._ports, *self._heard, *self.network.links) if at.dpid == dpid}
        for at in ends:
            self.port_down(at)

    def hurry(self, now: float) -> None:
        """Let every port speak quickly again, because somebody new may hear it."""
        for at in self._ports:
            self.port_up(at, now)

    def due(self, now: float) -> list[SwitchPort]:
        """Return the ports that shall speak now."""
        speaking = []
        for at, port in self._ports.items():
            if port.due <= now:
                port.sent += 1
                port.due = now + (LINK_FAST_PERIOD_S if port.sent < FAST_TIMES else LINK_PERIOD_S)
                speaking.append(at)
        return speaking

    def heard(self, speaker: SwitchPort, at: SwitchPort, now: float) -> bool:
        """Take what a port was heard to say at another; tell whether that is a new link."""
        if speaker not in self._ports or at not in self._ports:
            return False  # a message that was long on its way
        self._heard[at] = speaker, now
        there, _ = self._heard.get(speaker, (None, 0.0))
        return there == at and self.network.add_link(speaker, at)

    def expired(self, now: float) -> list[SwitchPort]:
        """Forget the links that were not heard for long at one end; return these ends."""
        silent = [at for at, (_, when) in self._heard.items() if now - when > LINK_EXPIRY_S]
        for at in silent:
            del self._heard[at]
        return [at for at in silent if self.network.remove_link(at) is not None]
