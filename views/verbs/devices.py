"""qmn devices: what the controller knows of every device of the running network."""

import argparse
import json
from typing import Any

from rich.table import Table

from qmn.needs import Needs
from qmn.running.controller_console import answered, ask, wide_console
from qmn.running.tables import HOST_COLUMNS, host_row, number_text, state, table

OPTICS = {
    "frequency_mhz": "MHz",
    "tx_power_dbm": "dBm out",
    "rx_power_dbm": "dBm in",
    "temperature_c": "deg C",
}


def add_parser(verbs: Any) -> None:
    parser = verbs.add_parser("devices", description=__doc__)
    parser.add_argument("--json", action="store_true", help="print everything, for programs")
    parser.set_defaults(call=call, needs=Needs.RUNNING)


def call(arguments: argparse.Namespace) -> int:
    return answered(lambda: show(ask("devices"), arguments.json))


def show(devices: list[dict[str, Any]], as_json: bool) -> None:
    if as_json:
        print(json.dumps(devices, indent=2))
        return
    console = wide_console()
    hosts = [device for device in devices if device["kind"] == "host"]
    for switch in [device for device in devices if device["kind"] == "quantum-switch"]:
        console.print(switch_table(switch))
    console.print(table("hosts", HOST_COLUMNS, [host_row(host) for host in hosts]))


def switch_table(switch: dict[str, Any]) -> Table:
    """Return the ports of a quantum switch, one a line."""
    title = f"{switch['name']}: quantum switch {switch['dpid']}, {state(switch)}"
    leads_to = {path["in_port"]: path["out_port"] for path in switch["paths"]}
    rows = []
    for port in switch["ports"]:
        counts = [number_text(port.get(f"photons_{way}")) for way in ("in", "out", "lost")]
        light = port.get("light") or {}
        optics = [number_text(light.get(name)) for name in OPTICS]
        out, up = leads_to.get(port["port"]), "up" if port["up"] else "cut"
        rows.append([f"{port['port']} {port['name']}", up, *counts, *optics, number_text(out)])
    columns = ("port", "", "photons in", "out", "lost", *OPTICS.values(), "to")
    return table(title, columns, rows)
