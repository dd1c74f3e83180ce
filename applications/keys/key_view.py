"""Nodes, key links and applications as plain values, in the words of ETSI GS QKD 015 (V2.1.1).

Fields of the standard that a host does not report are left out; so are its interfaces, which are
those of OpenFlow here. Identifiers are UUIDs made of names; `names` has what people call them.
"""

from typing import Any
from uuid import NAMESPACE_DNS, uuid5

from applications.keys.key_network import Application, KeyNetwork
from applications.keys.route_messages import UNKNOWN, LinkState

_NAMESPACE = uuid5(NAMESPACE_DNS, "nodes.qmn.example")
PPM = 1e6


def identifier(*names: str) -> str:
    return str(uuid5(_NAMESPACE, "/".join(names)))


def keys_view(network: KeyNetwork, now: float) -> list[dict[str, Any]]:
    return [
        _node(network, host, now) for host in sorted(network.hosts, key=network.names.__getitem__)
    ]


def _node(network: KeyNetwork, host: str, now: float) -> dict[str, Any]:
    name = network.names[host]
    links = [_link(network, host, *item) for item in network.links_of(host, now)]
    applications = [item for item in network.applications.values() if host in item.nodes]
    virtual = {
        (item.nodes[0], item.nodes[-1]): item for item in applications if len(item.nodes) > 2
    }
    return {
        "qkdn_id": identifier(name),
        "qkdn_location_id": name,
        "qkdn_capabilities": {
            "link_stats_support": True,
            "application_stats_support": False,
            "key_relay_mode_enable": any(
                item.host in ("*", name) for item in network.policy.trusted
            ),
        },
        "qkd_links": {
            "qkd_link": [*links, *(_virtual(network, host, item) for item in virtual.values())]
        },
        "qkd_applications": {
            "qkd_app": [
                _application(network, item)
                for item in applications
                if host in (item.nodes[0], item.nodes[-1])
            ]
        },
    }


def _link(network: KeyNetwork, host: str, link: LinkState, usable: bool) -> dict[str, Any]:
    near, far = network.names[host], network.names[link.peer]
    performance: dict[str, Any] = {"skr": link.rate_bps}
    if link.qber_ppm != UNKNOWN:
        performance["phys_perf"] = [{"perf_type": "QBER", "value": link.qber_ppm / PPM}]
    return {
        **_common(near, far, "PHYS", "ACTIVE" if usable else "OFF"),
        "qkdl_applications": _backed(network, (near, far)),
        "qkdl_performance": performance,
        "qmn": {
            "from": near,
            "to": far,
            "stored_keys": [link.mine, link.theirs],
            "max_key_count": link.capacity,
        },
    }


def _virtual(network: KeyNetwork, host: str, application: Application) -> dict[str, Any]:
    """Return a route as the node sees it: which one is before it, and which one after."""
    nodes = [network.names[node] for node in application.nodes]
    place = application.nodes.index(host)
    return {
        **_common(nodes[0], nodes[-1], "VIRT", "ACTIVE"),
        "qkdl_applications": _backed(network, (nodes[0], nodes[-1])),
        "virt_prev_hop": identifier(nodes[place - 1]) if place else None,
        "virt_next_hop": [identifier(node) for node in nodes[place + 1 : place + 2]],
        "qmn": {"from": nodes[0], "to": nodes[-1], "route": nodes},
    }


def _common(one: str, other: str, kind: str, status: str) -> dict[str, Any]:
    return {
        "qkdl_id": link_id(one, other),
        "qkdl_type": kind,
        "qkdl_status": status,
        "qkdl_local": {"qkdn_id": identifier(one)},
        "qkdl_remote": {"qkdn_id": identifier(other)},
    }


def _backed(network: KeyNetwork, ends: tuple[str, str]) -> list[str]:
    """Return the applications whose keys come from a link, as seen from either end."""
    return [
        _application(network, application)["app_id"]
        for application in network.applications.values()
        if {network.names[application.nodes[0]], network.names[application.nodes[-1]]} == set(ends)
    ]


def _application(network: KeyNetwork, application: Application) -> dict[str, Any]:
    """Return a master and a slave; the standard's server is the master."""
    nodes = [network.names[node] for node in application.nodes]
    return {
        "app_id": identifier("application", application.master, application.slave),
        "app_type": "CLIENT",
        "app_status": "ON",
        "server_app_id": application.master,
        "client_app_id": [application.slave],
        "local_qkdn_id": identifier(nodes[0]),
        "remote_qkdn_id": identifier(nodes[-1]),
        "backing_qkdl_id": [link_id(nodes[0], nodes[-1])],
    }


def link_id(one: str, other: str) -> str:
    """Return the UUID of the link of two hosts: the same for both ends."""
    return identifier("link", *sorted((one, other)))
