"""The optics of quantum switches as they report them: loss and rotation of paths, port tuning.

Optics that a switch has not reported count as no loss, no rotation and a port that takes any light.
"""

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import NamedTuple

from wire.optical import (
    ANY_PORT,
    VALID_RX_PWR,
    VALID_RX_TUNE,
    VALID_TX_PWR,
    VALID_TX_TUNE,
    PathOptics,
    PortLight,
    PortOptics,
)

HOST_TX_POWER = 0  # dBm * 10, launched by every host
MDB_PER_POWER_UNIT = 100  # power is in tenths of a dB
BOTH_TUNED = VALID_RX_TUNE | VALID_TX_TUNE
NOT_TOLD = PathOptics(ANY_PORT, ANY_PORT, 0, 0)


class SwitchPort(NamedTuple):
    dpid: int
    port: int


@dataclass(frozen=True)
class SwitchOptics:
    """The paths of one switch; those not in `paths` are like `others`."""

    others: PathOptics = NOT_TOLD
    paths: dict[tuple[int, int], PathOptics] = field(default_factory=dict)
    stuck_from: dict[int, int] = field(default_factory=dict)  # in_port to out_port
    stuck_to: dict[int, int] = field(default_factory=dict)  # out_port to in_port

    @classmethod
    def reported(cls, entries: Iterable[PathOptics]) -> "SwitchOptics":
        paths = {(entry.in_port, entry.out_port): entry for entry in entries}
        others = paths.pop((ANY_PORT, ANY_PORT), NOT_TOLD)
        stuck = [ports for ports, entry in paths.items() if entry.stuck]
        return cls(others, paths, dict(stuck), {out_port: in_port for in_port, out_port in stuck})

    def path(self, in_port: int, out_port: int) -> PathOptics | None:
        """Return what a path does to light, None if a stuck one stands in its way."""
        if self.stuck_from.get(in_port, out_port) != out_port:
            return None
        if self.stuck_to.get(out_port, in_port) != in_port:
            return None
        return self.paths.get((in_port, out_port), self.others)

    @property
    def least_loss_mdb(self) -> int:
        return min(path.loss_mdb for path in (self.others, *self.paths.values()))


UNKNOWN = SwitchOptics()


@dataclass
class Optics:
    switches: dict[int, SwitchOptics] = field(default_factory=dict)  # by datapath id
    ranges: dict[SwitchPort, PortOptics] = field(default_factory=dict)
    tuned_mhz: dict[SwitchPort, int] = field(default_factory=dict)
    lights: dict[SwitchPort, PortLight] = field(default_factory=dict)  # as last measured
    changes: int = field(default=0, compare=False)  # another number if losses or ranges may differ
    _channels_mhz: list[int] | None = field(default=None, init=False, compare=False, repr=False)

    def described(self, at: SwitchPort, port: PortOptics) -> None:
        if self.ranges.get(at) != port:
            self.ranges[at] = port
            self.changes += 1
            self._channels_mhz = None

    def take(self, dpid: int, optics: SwitchOptics) -> None:
        if self.switches.get(dpid) != optics:
            self.switches[dpid] = optics
            self.changes += 1

    def path(self, dpid: int, in_port: int, out_port: int) -> PathOptics | None:
        """Return what a path through a switch does to light, None if it cannot be had."""
        return self.switches.get(dpid, UNKNOWN).path(in_port, out_port)

    def measured(self, at: SwitchPort, light: PortLight) -> bool:
        """Take the statistics of a port; tell whether it is tuned differently than was known."""
        before, self.lights[at] = self.lights.get(at), light
        if _power(before) != _power(light):
            self.changes += 1
        if light.flags & BOTH_TUNED != BOTH_TUNED or light.tx_mhz != light.rx_mhz:
            self.tuned_mhz.pop(at, None)  # unknown, or of no use for light in both directions
            return False
        news = self.tuned_mhz.get(at) != light.tx_mhz
        self.tuned_mhz[at] = light.tx_mhz
        return news

    @property
    def channels_mhz(self) -> list[int]:
        """The frequencies of all ports that are channels of a fibre, in order."""
        if self._channels_mhz is None:
            fixed = {port.tx_min_mhz for port in self.ranges.values() if is_channel(port)}
            self._channels_mhz = sorted(fixed)
        return self._channels_mhz

    def is_of_channel(self, at: SwitchPort, frequency_mhz: int) -> bool:
        """Tell whether a port is this channel of a fibre, or of a fibre without channels."""
        port = self.ranges.get(at)
        return port is None or not is_channel(port) or port.tx_min_mhz == frequency_mhz

    def forget_light(self, at: SwitchPort) -> None:
        self.lights.pop(at, None)
        self.changes += 1

    def forget_switch(self, dpid: int) -> None:
        self.switches.pop(dpid, None)
        self._channels_mhz = None
        self.changes += 1
        for table in (self.ranges, self.tuned_mhz, self.lights):
            for at in [at for at in table if at.dpid == dpid]:
                del table[at]

    def can_carry(self, at: SwitchPort, frequency_mhz: int) -> bool:
        port = self.ranges.get(at)
        return port is None or (
            _in_band(frequency_mhz, port.tx_min_mhz, port.tx_max_mhz, port.tx_grid_mhz)
            and _in_band(frequency_mhz, port.rx_min_mhz, port.rx_max_mhz, port.rx_grid_mhz)
        )

    def must_tune(self, at: SwitchPort, frequency_mhz: int) -> bool:
        """Tell whether a port is, as far as is known, not tuned to a frequency."""
        port = self.ranges.get(at)
        return port is not None and not is_channel(port) and self.tuned_mhz.get(at) != frequency_mhz

    def fiber_loss_mdb(self, near: SwitchPort, far: SwitchPort | None) -> int:
        """Return what light loses from near to far, in thousandths of a dB; far None: a host.

        A fibre is alike in both directions, so that to a host is measured on its way here.
        """
        launched: int | None
        if far is None:
            launched, arrived = HOST_TX_POWER, self._rx_power(near)
        else:
            launched, arrived = self._tx_power(near), self._rx_power(far)
        lost = 0 if launched is None or arrived is None else launched - arrived
        return max(lost, 0) * MDB_PER_POWER_UNIT

    def _tx_power(self, at: SwitchPort) -> int | None:
        light = self.lights.get(at)
        return light.tx_power if light and light.flags & VALID_TX_PWR else None

    def _rx_power(self, at: SwitchPort) -> int | None:
        light = self.lights.get(at)
        return light.rx_power if light and light.flags & VALID_RX_PWR else None


def is_channel(port: PortOptics) -> bool:
    return 0 < port.tx_min_mhz == port.tx_max_mhz == port.rx_min_mhz == port.rx_max_mhz


def _power(light: PortLight | None) -> tuple[int, int, int] | None:
    if light is None:
        return None
    return (light.flags & (VALID_TX_PWR | VALID_RX_PWR), light.tx_power, light.rx_power)


def _in_band(frequency_mhz: int, least_mhz: int, most_mhz: int, grid_mhz: int) -> bool:
    on_grid = grid_mhz == 0 or (frequency_mhz - least_mhz) % grid_mhz == 0
    return least_mhz <= frequency_mhz <= most_mhz and on_grid
