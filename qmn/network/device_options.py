"""Options of hosts' devices on the command line.

--node ion-trap --node bob=photonic --device bob.detectors.efficiency=0.8
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from typing import Any

from topologies.catalogue.node_kinds import NODE_KINDS, node_device
from wire.parameters.checks import check_names, number
from wire.parameters.physics import BadParameter, Device

IDEAL = asdict(Device())


def kind_of_all(words: Sequence[str]) -> str:
    """Return the kind of the hosts of which nothing else is said, "" for none in particular.

    Raise BadParameter for two.
    """
    kinds = [word for word in words if "=" not in word]
    if len(kinds) > 1:
        raise BadParameter(f"--node {kinds[0]} and --node {kinds[1]}: choose one for all hosts")
    return kinds[0] if kinds else ""


def base_device(words: Sequence[str], preset: Device) -> Device:
    """Return the device of the hosts of which nothing else is said; raise BadParameter."""
    kind = kind_of_all(words)
    return node_device(kind, preset) if kind else preset


def nodes(words: Sequence[str], preset: Device) -> dict[str, Device]:
    """Return the devices of the hosts whose kind is named; raise BadParameter."""
    given: dict[str, Device] = {}
    for word in words:
        host, equals, kind = word.partition("=")
        if not equals:
            continue
        if not host or not kind or host in given:
            kinds = ", ".join(NODE_KINDS)
            raise BadParameter(f"--node {word}: write KIND, or HOST=KIND once a host, of {kinds}")
        given[host] = node_device(kind, preset)
    return given


def devices(
    words: Sequence[str], base: Device, named: Mapping[str, Device] | None = None
) -> dict[str, Device]:
    """Return the devices of the hosts that are named, where a base says the rest.

    `named` are hosts that have other bases. Raise BadParameter for words that name no
    parameter, or a value that cannot be.
    """
    given = dict(named or {})
    for word in words:
        place, _equals, text = word.partition("=")
        host, part, name = [*place.split("."), "", ""][:3]
        if not text or not host or place.count(".") != 2:
            raise BadParameter(
                f"--device {word}: write HOST.PART.NAME=VALUE, of {', '.join(IDEAL)}"
            )
        check_names(f"--device {word}: a device", [part], IDEAL, BadParameter)
        check_names(f"--device {word}: {part}", [name], IDEAL[part], BadParameter)
        device = given.get(host, base)
        changed = replace(getattr(device, part), **{name: _value(word, text, IDEAL[part][name])})
        given[host] = replace(device, **{part: changed})
    for host, device in given.items():
        device.check(host)
    return given


def _value(word: str, text: str, default: Any) -> Any:
    try:
        if default is None:
            return tuple(json.loads(text))
        if isinstance(default, int | float):
            return number(f"--device {word}", text, type(default), BadParameter)
        return dict(json.loads(text)) if isinstance(default, dict) else type(default)(text)
    except (TypeError, ValueError) as error:
        raise BadParameter(f"--device {word}: {error}") from error
