"""qmn keys: the key links of the running network, and by whom the keys of applications go."""

import argparse
import json
from typing import Any

from qmn.live.controller_console import answered, ask, wide_console
from qmn.live.tables import table

LINKS = ("key link", "", "", "keys ready", "of the other end", "bits/s", "QBER", "state")
APPLICATIONS = ("application", "with", "by way of")


def add_parser(verbs: Any) -> None:
    """Describe the verb."""
    parser = verbs.add_parser("keys", help="show key links and relays", description=__doc__)
    parser.add_argument("--json", action="store_true", help="as ETSI GS QKD 015 names it")
    parser.set_defaults(call=call, needs_root=True)


def call(arguments: argparse.Namespace) -> int:
    """Ask and print."""
    return answered(lambda: ask_and_show(arguments.json))


def ask_and_show(as_json: bool) -> None:
    """Print what the controller knows; raise NoAnswer if it does not answer."""
    told = ask("keys")
    if as_json:
        print(json.dumps(told, indent=2))
        return
    console = wide_console()
    console.print(table("key links", LINKS, link_rows(told["qkd_nodes"])))
    console.print(table("applications", APPLICATIONS, application_rows(told["qkd_nodes"])))


def link_rows(nodes: list[dict[str, Any]]) -> list[list[str]]:
    """Return the line of each link of light, as each of its ends tells it."""
    return [
        _link_row(link)
        for node in nodes
        for link in node["qkd_links"]["qkd_link"]
        if link["qkdl_type"] == "PHYS"
    ]


def _link_row(link: dict[str, Any]) -> list[str]:
    told = link["qmn"]
    performance = link["qkdl_performance"]
    qber = next((each["value"] for each in performance.get("phys_perf", ())), None)
    mine, theirs = (f"{count:,}" for count in told["stored_keys"])
    return [
        told["from"],
        "->",
        told["to"],
        mine,
        theirs,
        f"{performance['skr']:,}",
        "-" if qber is None else f"{qber:.4f}",
        link["qkdl_status"].lower(),
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
