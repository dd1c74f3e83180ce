"""Devices as plain values, for the console and for REST."""

from dataclasses import asdict
from typing import Any

from controller_apps.devices.hosts_state import SILENT_AFTER, HostState
from controller_apps.devices.switch_state import SwitchState
from wire.device import OF_LIGHT, DeviceReport, setting_name


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
    """Return a host: what its device does, has done, and is set to."""
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
