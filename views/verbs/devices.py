"""qmn devices: what the controller knows of every device of the running network."""

import argparse
import json
from typing import Any

from qmn.needs import Needs
from qmn.running.controller_console import answered, ask, wide_console
from qmn.running.tables import hosts_table, switch_table


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
    console.print(hosts_table(hosts))
