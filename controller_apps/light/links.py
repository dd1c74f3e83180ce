"""Fibres between switches, as heard from both their ends.

    port up --> speaks, and again until it hears somebody, then every LINK_PERIOD_S
    hears who has not heard it --> answers at once
    heard at both ends --> a link --port down, switch gone, not heard for long--> none

Where a host is, nobody hears a port; a fibre that is laid elsewhere is cut first, and the port
speaks again when it is whole.

No socket, no clock: `now` is in seconds of one steady clock.
"""

from dataclasses import dataclass, field
from math import inf

from controller_apps.light.optics import SwitchPort
from controller_apps.light.paths import Network
from controller_apps.timeouts import LINK_EXPIRY_S, LINK_FAST_PERIOD_S, LINK_PERIOD_S

FAST_TIMES = 10  # while the network starts (802.1AB fast start)
ANNOUNCEMENTS_PER_S = 25  # at most, of all ports that have been heard: each less often then
LEAST_AT_ONCE = 4  # of these that are due


@dataclass
class _Port:
    due: float
    sent: int = 0
    spoke_s: float = -inf

    def speak(self, now: float, pause_s: float) -> None:
        self.sent += 1
        self.spoke_s, self.due = now, now + pause_s


@dataclass(frozen=True)
class _Heard:
    """What a port has heard last, and how seldom ports spoke then: so long it may be silent."""

    speaker: SwitchPort
    when_s: float
    slower: float


@dataclass
class Links:
    """When each fibre port speaks next, and what was last heard where."""

    network: Network
    _ports: dict[SwitchPort, _Port] = field(default_factory=dict)
    _heard: dict[SwitchPort, _Heard] = field(default_factory=dict)
    _last_s: float = 0.0  # when it was asked who shall speak
    _slower: float = 1.0  # how many times longer a large network waits than a small one

    def port_up(self, at: SwitchPort, now: float) -> None:
        self._ports[at] = _Port(now)

    def port_down(self, at: SwitchPort) -> None:
        self._ports.pop(at, None)
        self._heard.pop(at, None)
        self.network.remove_link(at)

    def switch_left(self, dpid: int) -> None:
        ends = {at for at in (*self._ports, *self._heard, *self.network.links) if at.dpid == dpid}
        for at in ends:
            self.port_down(at)

    def _measure(self) -> None:
        """Note how large the network is: of the ports that speak, those of hosts do not."""
        speaking = sum(at not in self.network.hosts for at in self._ports)
        self._slower = max(1.0, speaking / (LINK_PERIOD_S * ANNOUNCEMENTS_PER_S))

    def due(self, now: float) -> list[SwitchPort]:
        """Return the ports that shall speak now; never all of a large network at once."""
        self._measure()
        period_s, spoken, waiting = LINK_PERIOD_S * self._slower, [], []
        for at, port in self._ports.items():
            if at in self.network.hosts:
                continue
            if port.due <= now and self._is_new(at, port):
                port.speak(now, LINK_FAST_PERIOD_S if port.sent + 1 < FAST_TIMES else period_s)
                spoken.append(at)
            elif port.due <= now:
                waiting.append((port.due, at))
        waiting.sort()
        at_once = LEAST_AT_ONCE + int(ANNOUNCEMENTS_PER_S * (now - self._last_s))
        for _due, at in waiting[:at_once]:
            self._ports[at].speak(now, period_s)
            spoken.append(at)
        self._last_s = now
        return spoken

    def _is_new(self, at: SwitchPort, port: _Port) -> bool:
        """Whether nobody was heard at a port that has not spoken often either."""
        return at not in self._heard and port.sent < FAST_TIMES

    def answers(self, at: SwitchPort, speaker: SwitchPort, now: float) -> bool:
        """Tell whether a port that has heard another shall speak now: to who has not heard it.

        What it has said a moment ago is on its way.
        """
        port, heard = self._ports.get(at), self._heard.get(speaker)
        if port is None or (heard is not None and heard.speaker == at):
            return False
        if now - port.spoke_s < LINK_FAST_PERIOD_S:
            return False
        port.speak(now, LINK_PERIOD_S * self._slower)
        return True

    def heard(self, speaker: SwitchPort, at: SwitchPort, now: float) -> bool:
        """Take what a port was heard to say at another; tell whether that is a new link."""
        if speaker not in self._ports or at not in self._ports:
            return False  # a message that was long on its way
        self._heard[at] = _Heard(speaker, now, self._slower)
        there = self._heard.get(speaker)
        return there is not None and there.speaker == at and self.network.add_link(speaker, at)

    def expired(self, now: float) -> list[SwitchPort]:
        """Forget the links that were not heard for long at one end; return these ends."""
        self._measure()
        silent = [at for at, heard in self._heard.items() if self._is_silent(heard, now)]
        for at in silent:
            del self._heard[at]
        return [at for at in silent if self.network.remove_link(at) is not None]

    def _is_silent(self, heard: _Heard, now: float) -> bool:
        """Whether a port has heard nothing for too long, by how seldom ports spoke or speak."""
        return now - heard.when_s > LINK_EXPIRY_S * max(heard.slower, self._slower)
