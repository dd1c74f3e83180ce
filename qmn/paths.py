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
    return answered(lambda: show({**ask("paths"), "sessions": ask("sessions")}, arguments.json))


def show(known: dict[str, Any], as_json: bool) -> None:
    """Print paths, sessions and fibres as JSON or as tables."""
    if as_json:
        print(json.dumps(known, indent=2))
        return
    console = wide_console()
    sessions = {session["session"]: session for session in known["sessions"]}
    console.print(
        table(
            "light paths" if known["paths"] else "light paths: none",
            ("session", "from", "to", "pairs of", "light from", "to", "loss", "by"),
            [path_row(path) for path in known["paths"]],
        )
    )
    dark = set(sessions) - {path["session"] for path in known["paths"]}
    if dark:
        console.print(f"sessions without a light path now: {', '.join(sorted(dark))}")
    rows = [
        [f"{short(fiber['dpid'])}:{fiber['port']}", fiber["to"], "whole" if fiber["up"] else "cut"]
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


def path_row(path: dict[str, Any]) -> list[str]:
    """Return the line of one light path."""
    hops = ", ".join(
        f"{short(hop['dpid'])}:{hop['in_port']}->{hop['out_port']}" for hop in path["hops"]
    )
    names = [path[name] for name in ("session", "from", "to", "source", "begin", "end")]
    return [*names, f"{path['loss_db']:g} dB", hops]


def short(dpid: str) -> str:
    """Return a datapath id as Mininet's users write it."""
    return f"{int(dpid, 16):#x}"
