"""The state of a quantum switch's ports and paths, from OpenFlow statistics.

Optical values come in the units of wire.optical (MHz, dBm * 10, mA * 10, degrees C * 10);
signed ones in unsigned fields, as the frameworks decode them.
"""

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

from wire.optical import (
    OPTICAL,
    VALID_RX_PWR,
    VALID_TX_BIAS,
    VALID_TX_PWR,
    VALID_TX_TEMP,
    VALID_TX_TUNE,
)

MAX_PORT = 0xFFFFFF00  # OFPP_MAX
NOT_AVAILABLE = (1 << 64) - 1  # a counter that a switch does not have (OpenFlow 1.4, 5.8)
LOCAL = 0xFFFFFFFE  # OFPP_LOCAL: the bridge itself, named as the switch


@dataclass
class SwitchState:
    """One switch as it was heard last; `ports` and `paths` are plain values."""

    dpid: int
    heard: float
    connected: bool = True
    name: str = ""
    ports: dict[int, dict[str, Any]] = field(default_factory=dict)
    paths: list[dict[str, Any]] = field(default_factory=list)
    _listed: list[dict[str, Any]] = field(default_factory=list)  # of an unfinished reply

    def describe_port(self, port: Any, gone: bool = False) -> bool:
        """Take in the description of a port; tell whether what it says has changed."""
        if port.port_no == LOCAL:
            self.name = port.name.decode("ascii", "replace")
        if port.port_no > MAX_PORT:
            return False
        before = self.ports.get(port.port_no, {})
        if gone:
            return self.ports.pop(port.port_no, None) is not None
        description = {
            "port": port.port_no,
            "name": port.name.decode("ascii", "replace"),
            "up": not (port.config & 1 or port.state & 1),  # OFPPC_PORT_DOWN, OFPPS_LINK_DOWN
            "tuning": _tuning(port.properties),
        }
        self.ports[port.port_no] = {**before, **description}
        return any(before.get(name) != value for name, value in description.items())

    def count_port(self, statistics: Any) -> None:
        """Take in the counters of a port; those of a port with light count photons."""
        port = self.ports.get(statistics.port_no)
        if port is None:
            return
        light = _light(statistics.properties)
        what = "packets" if light is None else "photons"
        port.update(
            {
                f"{what}_in": _counter(statistics.rx_packets),
                f"{what}_out": _counter(statistics.tx_packets),
                f"{what}_lost": _counter(statistics.rx_dropped),
                "light": light,
            }
        )

    def list_paths(self, entries: Iterable[Any], more: bool) -> None:
        """Take in a part of the flow table; the light paths in it are shown when it is whole."""
        self._listed += [path for entry in entries for path in _path(entry)]
        if not more:
            self.paths, self._listed = self._listed, []


def _tuning(properties: Iterable[Any]) -> dict[str, int | float] | None:
    for optical in properties or ():
        if optical.type == OPTICAL:
            return {
                "min_frequency_mhz": optical.tx_min_freq_lmda,
                "max_frequency_mhz": optical.tx_max_freq_lmda,
                "grid_mhz": optical.tx_grid_freq_lmda,
                "min_power_dbm": signed(optical.tx_pwr_min) / 10,
                "max_power_dbm": signed(optical.tx_pwr_max) / 10,
            }
    return None


def _light(properties: Iterable[Any]) -> dict[str, int | float | None] | None:
    """Return what a port measures; None for what its flags say is not valid."""
    for optical in properties or ():
        if optical.type == OPTICAL:
            values = {
                "frequency_mhz": (VALID_TX_TUNE, optical.tx_freq_lmda),
                "tx_power_dbm": (VALID_TX_PWR, signed(optical.tx_pwr) / 10),
                "rx_power_dbm": (VALID_RX_PWR, signed(optical.rx_pwr) / 10),
                "bias_ma": (VALID_TX_BIAS, optical.bias_current / 10),
                "temperature_c": (VALID_TX_TEMP, signed(optical.temperature) / 10),
            }
            return {
                name: value if optical.flags & flag else None
                for name, (flag, value) in values.items()
            }
    return None


def _path(entry: Any) -> list[dict[str, Any]]:
    """Return the light path that an entry makes, nothing if it makes none."""
    match = dict(entry.match.items())
    actions = [
        action
        for instruction in entry.instructions
        for action in getattr(instruction, "actions", ())
    ]
    outputs = [getattr(action, "port", MAX_PORT + 1) for action in actions]
    if set(match) != {"in_port"} or len(outputs) != 1 or outputs[0] > MAX_PORT:
        return []
    return [
        {
            "in_port": match["in_port"],
            "out_port": outputs[0],
            "session": f"{entry.cookie:016x}",
            "photons": _counter(entry.packet_count),
            "duration_s": round(entry.duration_sec + entry.duration_nsec / 1e9, 3),
        }
    ]


def _counter(value: int) -> int | None:
    return None if value == NOT_AVAILABLE else value


def signed(value: int) -> int:
    """Return what an unsigned 16-bit field means as a signed number."""
    return value - (1 << 16) if value & 0x8000 else value
