"""The controller's view of the hosts' devices: reports in, datagrams out.

Datagrams may be lost, so nothing here is sent once: a report that does not show what is
wanted (the overrides, the subscription) is answered by asking again. No socket, no clock:
`now` is in seconds of one steady clock, `number` in nanoseconds of one that never goes back
between two lives of the controller.
"""

from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from typing import Any

from controller_apps.devices.switch_state import SwitchState
from controller_apps.light.optics import SwitchPort
from controller_apps.policy.policy import Reporting
from wire.device import (
    OF_LIGHT,
    Datagram,
    DeviceReport,
    DeviceSettings,
    SetDevice,
    Subscribe,
    host_of,
    open_sealed,
    setting_name,
)
from wire.malformed import MalformedPacket
from wire.metadata.header import Message
from wire.metadata.setup import Answer
from wire.metadata.vocabulary import Reason
from wire.monitor_messages import SessionEstimate

SILENT_AFTER = 3.5  # periods without a word


@dataclass(frozen=True)
class Place:
    """Where a host was heard: behind which port of which classical switch."""

    dpid: int
    port: int
    mac: bytes
    address: str

    @property
    def at(self) -> SwitchPort:
        return SwitchPort(self.dpid, self.port)


@dataclass
class HostState:
    place: Place
    report: DeviceReport
    heard: float
    number: int  # of its last datagram


@dataclass(frozen=True)
class Report:
    """The content of a datagram: a change, the answer to a request, or an estimate."""

    host: str
    changed: bool = False
    first: bool = False
    alarm: int = 0  # the session of a link monitor with an alarm since the last report
    monitor_ended: bool = False  # whether another link monitor of this host has ended since then
    answer: Answer | None = None
    estimate: SessionEstimate | None = None


@dataclass
class Hosts:
    keys: dict[str, str]  # by host name
    wanted: dict[str, DeviceSettings] = field(default_factory=dict)  # overrides, by host name
    reporting: Reporting = field(default_factory=Reporting)
    states: dict[str, HostState] = field(default_factory=dict)

    def heard(self, data: bytes, place: Place, now: float) -> Report:
        """Take a host's datagram; raise MalformedPacket, and change nothing, for any other."""
        host = host_of(data)
        if host not in self.keys:
            raise MalformedPacket(f"no device key for {host!r}")
        datagram = open_sealed(data, self.keys[host], Datagram.FROM_HOST)
        state = self.states.get(host)
        if state is not None and datagram.number <= state.number:
            raise MalformedPacket(f"{host}: number {datagram.number} was used before")
        message = datagram.message
        if isinstance(message, DeviceReport):
            self.states[host] = HostState(place, message, now, datagram.number)
            changed = state is None or _facts(state.report) != _facts(message)
            before = state.report.alarm if state is not None else 0
            alarm = message.alarm if message.alarm != before else 0
            ended = message.monitor not in (0, state.report.monitor if state is not None else 0)
            return Report(host, changed, state is None, alarm, ended)
        if state is None or not isinstance(message, Answer | SessionEstimate):
            raise MalformedPacket(f"{host} sent {type(message).__name__} unasked")
        state.number, state.heard, state.place = datagram.number, now, place
        if isinstance(message, SessionEstimate):
            return Report(host, estimate=message)
        if message.reason != Reason.OK:  # it will not: want what is
            self.wanted[host] = state.report.settings
        return Report(host, answer=message)

    def due(self, host: str) -> list[Callable[[int], Message]]:
        """Return what to send to a host that it is not set to yet; each takes its number."""
        report = self.states[host].report
        messages: list[Callable[[int], Message]] = []
        overrides = self.wanted.get(host, DeviceSettings())
        if report.settings != overrides:
            messages.append(lambda number: SetDevice(number, overrides))
        subscription = self._subscription()
        if (report.period_ms, report.lost_ppm, report.symbol_error_ppm) != subscription:
            messages.append(lambda number: Subscribe(number, *subscription))
        return messages

    def seal(self, host: str, message: Message, number: int) -> bytes:
        return Datagram(message, host, number).seal(self.keys[host], Datagram.FROM_CONTROLLER)

    def silent(self, host: str, now: float) -> bool:
        return now - self.states[host].heard > SILENT_AFTER * self.reporting.period_s

    def _subscription(self) -> tuple[int, int, int]:
        reporting = self.reporting
        return (
            round(reporting.period_s * 1e3),
            round(reporting.lost_share * 1e6),
            round(reporting.symbol_error_share * 1e6),
        )


def _facts(report: DeviceReport) -> tuple[object, ...]:
    """Return what is worth a line when it changes: not the counters."""
    return report.settings, report.ports, report.sending, report.receiving, report.serving


def switch_view(switch: SwitchState, now: float, period_s: float) -> dict[str, Any]:
    """Return a quantum switch: its ports, and the light paths in its flow table."""
    age_s = now - switch.heard
    state = "up" if age_s <= SILENT_AFTER * period_s else "silent"
    return {
        "name": switch.name or f"{switch.dpid:016x}",
        "kind": "quantum-switch",
        "dpid": f"{switch.dpid:016x}",
        "state": state if switch.connected else "disconnected",
        "heard_s_ago": round(age_s, 3),
        "ports": [port for _, port in sorted(switch.ports.items())],
        "paths": switch.paths,
    }


def host_view(name: str, state: HostState, silent: bool, age_s: float) -> dict[str, Any]:
    report = state.report
    return {
        "name": name,
        "kind": "host",
        "address": state.place.address,
        "state": "silent" if silent else "up",
        "heard_s_ago": round(age_s, 3),
        "ports": [asdict(port) for port in report.ports],
        "sessions": {
            "sending": report.sending,
            "receiving": report.receiving,
            "serving": report.serving,
        },
        "pairs_sent": report.pairs_sent,
        "pairs_made": report.pairs_made,
        "pairs_received": report.pairs_received,
        "pairs_lost": report.pairs_lost,
        "symbol_errors": report.symbol_errors,
        "repeated_frames": report.repeated_frames,
        "in_use": in_use(report),
        "overrides": {
            name: setting_name(name, value)
            for name, value in asdict(report.settings).items()
            if value is not None
        },
    }


def in_use(report: DeviceReport) -> dict[str, int | str | None]:
    """Return the settings of a host's last session; None are numbers that it has none of.

    All are None of a host that had no session yet.
    """
    if not report.rate_hz:
        return dict.fromkeys(OF_LIGHT)
    return {name: setting_name(name, getattr(report, name)) or None for name in OF_LIGHT}
