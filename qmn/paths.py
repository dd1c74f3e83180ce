"""qmn paths: the light paths that stand in the running network, and the fibres."""

import argparse
import json
from typing import Any

from rich.table import Table

from qmn.controller_console import answered, ask, wide_console


def add_parser(verbs: Any) -> None:
    """Describe the verb."""
    parser = verbs.add_parser("paths", help="show light paths and fibres", description=__doc__)
    parser.add_argument("--json", action="store_true", help="print everything, for programs")
    parser.set_defaults(call=call)


def call(arguments: argparse.Namespace) -> int:
    """Ask and print."""
    return answered(lambda: ask_and_show(arguments.json))


def ask_and_show(as_json: bool) -> None:
    """Print paths, sessions and fibres as JSON or as tables."""
    known = {**ask("paths"), "sessions": ask("sessions")}
    if as_json:
        print(json.dumps(known, indent=2))
        return
    names = {device["dpid"]: device["name"] for device in ask("devices") if "dpid" in device}
    show(known, names)


def show(known: dict[str, Any], names: dict[str, str]) -> None:
    """Print tables; names are those of the switches, by datapath id."""
    console = wide_console()
    columns = ("session", "from", "to", "pairs of", "light from", "to", "loss", "by")
    title = "light paths" if known["paths"] else "light paths: none"
    console.print(table(title, columns, [path_row(path, names) for path in known["paths"]]))
    lit = {path["session"] for path in known["paths"]}
    for session in known["sessions"]:
        if session["session"] not in lit:
            why = "waits for light" if session["waits_for_light"] else "has no light path now"
            console.print(f"{session['session']}, {session['from']} to {session['to']}: {why}")
    rows = [
        [
            switch_port(fiber["dpid"], fiber["port"], names),
            far_end(fiber["to"], names),
            "whole" if fiber["up"] else "cut",
        ]
        for fiber in known["fibers"]
    ]
    console.print(table("fibres", ("switch port", "to", ""), rows))


def table(title: str, columns: tuple[str, ...], rows: list[list[str]]) -> Table:
    """Return a table in the style of the other verbs."""
    made = Table(title=title, title_justify="left", box=None, padding=(0, 2, 0, 0))
    for column in columns:
        made.add_column(column)
    for row in rows:
        made.add_row(*row)
    return made


def path_row(path: dict[str, Any], names: dict[str, str]) -> list[str]:
    """Return the line of one light path."""
    hops = ", ".join(
        f"{switch_port(hop['dpid'], hop['in_port'], names)}->{hop['out_port']}"
        for hop in path["hops"]
    )
    ends = [path[name] for name in ("session", "from", "to", "source", "begin", "end")]
    return [*ends, f"{path['loss_db']:g} dB", hops]


def switch_port(dpid: str, port: object, names: dict[str, str]) -> str:
    """Return a port as a person names it: q1:3."""
    return f"{names.get(dpid, dpid)}:{port}"


def far_end(end: str, names: dict[str, str]) -> str:
    """Return where a fibre leads: a host's port as it is, a switch's as a person names it."""
    dpid, colon, port = end.rpartition(":")
    return switch_port(dpid, port, names) if colon else end
