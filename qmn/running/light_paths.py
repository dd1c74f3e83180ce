"""The light paths and fibres of the running network, asked of its controller and printed."""

import json
from typing import Any

from qmn.running.controller_console import ask, wide_console
from qmn.running.tables import far_end, path_row, switch_port, table


def ask_and_show(as_json: bool) -> None:
    reply = {**ask("paths"), "sessions": ask("sessions")}
    if as_json:
        print(json.dumps(reply, indent=2))
        return
    names = {device["dpid"]: device["name"] for device in ask("devices") if "dpid" in device}
    show(reply, names)


def show(reply: dict[str, Any], names: dict[str, str]) -> None:
    """Print tables; names are those of the switches, by datapath id."""
    console = wide_console()
    columns = ("session", "from", "to", "pairs of", "light from", "to", "loss", "by")
    title = "light paths" if reply["paths"] else "light paths: none"
    console.print(table(title, columns, [path_row(path, names) for path in reply["paths"]]))
    lit = {path["session"] for path in reply["paths"]}
    for session in reply["sessions"]:
        if session["session"] not in lit:
            why = "waits for light" if session["waits_for_light"] else "has no light path now"
            console.print(f"{session['session']}, {session['from']} to {session['to']}: {why}")
    rows = [
        [
            switch_port(fiber["dpid"], fiber["port"], names),
            far_end(fiber["to"], names),
            "whole" if fiber["up"] else "cut",
        ]
        for fiber in reply["fibers"]
    ]
    console.print(table("fibres", ("switch port", "to", ""), rows))
