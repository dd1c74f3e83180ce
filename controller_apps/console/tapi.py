"""Light paths in the terms of ONF's Transport API, 2.1.3, by RESTCONF (RFC 8040): what is read.

    context
    |-- service-interface-point          a fibre of a host
    `-- connectivity-context
        |-- connectivity-service         a light path, one way
        `-- connection                   the same, with its way through switches

A tree of plain values, and what is at a path of it.
"""

import re
from collections.abc import Iterable, Mapping
from typing import Any
from uuid import NAMESPACE_URL, uuid5

COMMON, CONNECTIVITY = "tapi-common", "tapi-connectivity"
LAYER = "PHOTONIC_MEDIA"
QUALIFIER = "tapi-photonic-media:PHOTONIC_LAYER_QUALIFIER_MC"
ENTRY = re.compile(r"([^=]+)(?:=([^,]+))?")
Fields = Mapping[str, Any]


def context(paths: Iterable[Fields], fibers: Iterable[Fields], sessions: Iterable[Fields]) -> Any:
    opened = {session["session"] for session in sessions if session["open"]}
    lit = [(path, path["session"] in opened) for path in paths]
    return {
        f"{COMMON}:context": {
            "service-interface-point": [
                _point(fiber) for fiber in fibers if ":" not in fiber["to"]
            ],
            f"{CONNECTIVITY}:connectivity-context": {
                "connectivity-service": [_service(path, stands) for path, stands in lit],
                "connection": [_connection(path, stands) for path, stands in lit],
            },
        }
    }


def resource(tree: Any, path: str) -> Any:
    """Return what a RESTCONF path below /restconf/data names, None if there is nothing.

    A step is a name, with or without its module, and of an entry of a list `=` and its uuid.
    """
    node, name = tree, ""
    for step in path.strip("/").split("/"):
        parsed = ENTRY.fullmatch(step)
        if parsed is None or not isinstance(node, dict):
            return None
        name = next((entry for entry in node if _plain(entry) == _plain(parsed[1])), "")
        node = node.get(name)
        if parsed[2] is not None:
            entries = node if isinstance(node, list) else []
            node = next((entry for entry in entries if entry["uuid"] == parsed[2]), None)
            node = node if node is None else [node]
        if node is None:
            return None
    module = COMMON if "connect" not in name else CONNECTIVITY
    return {f"{module}:{_plain(name)}": node}


def not_found(path: str) -> Any:
    """Return the errors of a resource that is not there (RFC 8040, 3.9 and 7.1)."""
    message = f"there is no /restconf/data/{path}"
    error = {"error-type": "application", "error-tag": "invalid-value", "error-message": message}
    return {"ietf-restconf:errors": {"error": [error]}}


def _plain(name: str) -> str:
    return name.rpartition(":")[2]


def _uuid(*words: str) -> str:
    return str(uuid5(NAMESPACE_URL, "/".join(("qmn", *words))))


def _names(**names: Any) -> list[Fields]:
    return [{"value-name": name.upper(), "value": str(value)} for name, value in names.items()]


def _states(stands: bool) -> Fields:
    return {
        "administrative-state": "UNLOCKED",
        "operational-state": "ENABLED" if stands else "DISABLED",
        "lifecycle-state": "INSTALLED" if stands else "PLANNED",
    }


def _point(fiber: Fields) -> Fields:
    return {
        "uuid": _uuid("sip", fiber["to"]),
        "name": _names(fiber=fiber["to"], switch=fiber["dpid"], port=fiber["port"]),
        "layer-protocol-name": LAYER,
        "supported-layer-protocol-qualifier": [QUALIFIER],
        **_states(fiber["up"]),
    }


def _words(path: Fields) -> tuple[str, str, str]:
    return path["session"], path["begin"], path["end"]


def _service(path: Fields, stands: bool) -> Fields:
    ends = (path["begin"], "SOURCE"), (path["end"], "SINK")
    return {
        "uuid": _uuid("service", *_words(path)),
        "name": _names(
            session=path["session"],
            frequency_mhz=path["frequency_mhz"],
            loss_db=path["loss_db"],
        ),
        "layer-protocol-name": LAYER,
        "service-type": "POINT_TO_POINT_CONNECTIVITY",
        "connectivity-direction": "UNIDIRECTIONAL",
        "end-point": [_end_point(fiber, direction) for fiber, direction in ends],
        "connection": [{"connection-uuid": _uuid("connection", *_words(path))}],
        **_states(stands),
    }


def _end_point(fiber: str, direction: str) -> Fields:
    return {
        "local-id": fiber,
        "layer-protocol-name": LAYER,
        "layer-protocol-qualifier": QUALIFIER,
        "direction": direction,
        "service-interface-point": {"service-interface-point-uuid": _uuid("sip", fiber)},
    }


def _connection(path: Fields, stands: bool) -> Fields:
    hops = [f"{hop['dpid']}:{hop['in_port']}-{hop['out_port']}" for hop in path["hops"]]
    return {
        "uuid": _uuid("connection", *_words(path)),
        "name": _names(route=" ".join(hops)),
        "layer-protocol-name": LAYER,
        "layer-protocol-qualifier": QUALIFIER,
        "direction": "UNIDIRECTIONAL",
        "operational-state": "ENABLED" if stands else "DISABLED",
        "lifecycle-state": "INSTALLED" if stands else "PLANNED",
    }
