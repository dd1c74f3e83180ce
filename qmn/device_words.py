"""What the command line says of hosts' devices: --device bob.detectors.efficiency=0.8"""

import json
from collections.abc import Sequence
from dataclasses import asdict, replace
from typing import Any

from wire.physics import BadParameter, Device

IDEAL = asdict(Device())


def devices(words: Sequence[str], base: Device) -> dict[str, Device]:
    """Return the devices of the hosts that are named, where a base says the rest.

    Raise BadParameter for words that name no parameter, or a value that cannot be.
    """
    given: dict[str, Device] = {}
    for word in words:
        place, _equals, text = word.partition("=")
        host, part, name = [*place.split("."), "", ""][:3]
        if not text or not host or name not in IDEAL.get(part, {}) or place.count(".") != 2:
            known = "; ".join(f"{part}: {', '.join(names)}" for part, names in IDEAL.items())
            raise BadParameter(f"--device {word}: write HOST.PART.NAME=VALUE, of {known}")
        device = given.get(host, base)
        changed = replace(getattr(device, part), **{name: _value(word, text, IDEAL[part][name])})
        given[host] = replace(device, **{part: changed})
    for host, device in given.items():
        device.check(host)
    return given


def differences(device: Device) -> dict[str, dict[str, Any]]:
    """Return what of a device is not ideal, part by part."""
    found = {
        part: {name: value for name, value in values.items() if value != IDEAL[part][name]}
        for part, values in asdict(device).items()
    }
    return {part: values for part, values in found.items() if values}


def _value(word: str, text: str, default: Any) -> Any:
    """Return a parameter's value as the kind of its default."""
    try:
        return tuple(json.loads(text)) if default is None else type(default)(text)
    except (TypeError, ValueError) as error:
        raise BadParameter(f"--device {word}: {error}") from error
