"""qmn keys: the key links of the running network, and by whom the keys of applications go."""

import argparse
import json
from typing import Any

from qmn.needs import Needs
from qmn.running.controller_console import answered, ask, wide_console
from qmn.running.tables import table
from views.key_links import KeyLink, key_links

LINKS = ("key link", "", "", "keys ready", "of the other end", "bits/s", "QBER", "state")
APPLICATIONS = ("application", "with", "by way of")


def add_parser(verbs: Any) -> None:
    parser = verbs.add_parser("keys", description=__doc__)
    parser.add_argument("--json", action="store_true", help="as ETSI GS QKD 015 names it")
    parser.set_defaults(call=call, needs=Needs.RUNNING)


def call(arguments: argparse.Namespace) -> int:
    return answered(lambda: ask_and_show(arguments.json))


def ask_and_show(as_json: bool) -> None:
    """Print what the controller knows; raise NoAnswer if it does not answer."""
    nodes = ask("keys")
    if as_json:
        print(json.dumps(nodes, indent=2))
        return
    console = wide_console()
    console.print(table("key links", LINKS, [*map(link_row, key_links(nodes["qkd_nodes"]))]))
    console.print(table("applications", APPLICATIONS, application_rows(nodes["qkd_nodes"])))


def link_row(link: KeyLink) -> list[str]:
    """Return the line of a link of light, as one of its ends tells it."""
    return [
        link.from_,
        "->",
        link.to,
        f"{link.keys_ready:,}",
        f"{link.keys_ready_there:,}",
        f"{link.key_bits_per_s:,}",
        "-" if link.qber is None else f"{link.qber:.4f}",
        link.state,
    ]


def application_rows(nodes: list[dict[str, Any]]) -> list[list[str]]:
    """Return the line of each master and slave, and the hosts between theirs."""
    routes = {
        link["qkdl_id"]: link["qmn"]["route"]
        for node in nodes
        for link in node["qkd_links"]["qkd_link"]
        if link["qkdl_type"] == "VIRT"
    }
    return [
        [app["server_app_id"], slave, ", ".join(_between(app, routes)) or "-"]
        for node in nodes
        for app in node["qkd_applications"]["qkd_app"]
        if app["local_qkdn_id"] == node["qkdn_id"]
        for slave in app["client_app_id"]
    ]


def _between(app: dict[str, Any], routes: dict[str, list[str]]) -> list[str]:
    return [host for link in app["backing_qkdl_id"] for host in routes.get(link, [])[1:-1]]
