"""Paths and sessions as plain values, for the console and for REST."""

from typing import Any

from controller_apps.light.optics import SwitchPort
from controller_apps.light.paths import Network
from controller_apps.sessions.sessions import Request, Session, Sessions
from wire.device import OF_LIGHT, setting_name
from wire.metadata.vocabulary import Handshake, Service
from wire.parameters.switch import INNER_PORTS, inner_port


def sessions_view(sessions: Sessions, network: Network, now: float) -> list[dict[str, Any]]:
    return [
        {
            "session": f"{session.number:016x}",
            "service": Service(session.setup.service).name.lower(),
            "handshake": Handshake(session.setup.handshake).name.lower().replace("_", "-"),
            **_parties(session, network),
            **{name: setting_name(name, getattr(session.setup, name)) for name in OF_LIGHT},
            "open": session.open,
            "silent_s": round(now - session.seen, 3),
            "waits_for_light": session.owner in sessions.queue,
            "stranded": session.stranded,
            "hops": len(session.hops),
        }
        for session in sessions.by_number.values()
    ]


def paths_view(sessions: Sessions, network: Network) -> list[dict[str, Any]]:
    """Return each light path that stands, hop by hop, as the controller has asked for it."""
    return [
        {
            "session": f"{session.number:016x}",
            **_parties(session, network),
            "begin": _end(network, path.leg.start),
            "end": _end(network, path.leg.end),
            "loss_db": path.loss_mdb / 1000,
            "rotation": path.rotation,
            "frequency_mhz": session.frequency_mhz,
            "hops": [
                {"dpid": f"{hop.dpid:016x}", "in_port": hop.in_port, "out_port": hop.out_port}
                for hop in path.hops
            ],
        }
        for session in sessions.by_number.values()
        for path in session.paths
    ]


def request_view(request: Request, network: Network) -> dict[str, str]:
    return {
        "service": Service(request.setup.service).name.lower(),
        "from": name_of(network, request.five_tuple.source),
        "to": name_of(network, request.five_tuple.destination),
    }


def light_view(session: Session, network: Network) -> list[dict[str, Any]]:
    return [
        {
            "begin": _end(network, path.leg.start),
            "end": _end(network, path.leg.end),
            "by": [network.name_of(hop.dpid) for hop in path.hops],
            "loss_db": path.loss_mdb / 1000,
        }
        for path in session.paths
    ]


def fibers_view(network: Network) -> list[dict[str, Any]]:
    """Return where each fibre that has been discovered leads, and whether it is whole.

    One between switches that was cut is whole again when it was heard of by both ends.
    """
    ends = {at: _host(network, at) for at in network.hosts}
    whole = network.links.keys() | network.hosts.keys()
    ends |= {at: _port(far) for at, far in (network.broken | network.links).items()}
    return [
        {
            "dpid": f"{at.dpid:016x}",
            "port": at.port,
            "to": end,
            "up": at in whole and at not in network.cut,
        }
        for at, end in sorted(ends.items())
    ]


def node_features_view(network: Network) -> dict[str, dict[str, Any]]:
    """Return what each host has announced that it can do; nothing of one that has not."""
    views = {}
    for host in network.hosts.values():
        node_features = network.node_features_of(host.address)
        if node_features is not None:
            features = [str(feature.name).lower() for feature in node_features.features]
            views[host.host] = {"features": features, "memory_qubits": node_features.memory_qubits}
    return views


def name_of(network: Network, address: str) -> str:
    """Return the name a host has announced, its address if it has announced none."""
    ports = network.ports_of(address)
    return network.hosts[ports[0]].host if ports else address


def _parties(session: Session, network: Network) -> dict[str, str]:
    return {
        "from": name_of(network, session.owner.source),
        "to": name_of(network, session.owner.destination),
        "source": name_of(network, session.setup.source),
    }


def _host(network: Network, at: SwitchPort) -> str:
    host = network.hosts.get(at)
    return host.name if host else _port(at)


def _end(network: Network, at: SwitchPort) -> str:
    """Return the name of a host's port, or of the port of a part inside a switch."""
    if at.port in INNER_PORTS:
        return inner_port(at.port).name(network.name_of(at.dpid))
    return _host(network, at)


def _port(at: SwitchPort) -> str:
    return f"{at.dpid:016x}:{at.port}"
