"""Messages of gNMI and what they mean here: paths, values in each encoding, notifications."""

import json
from collections.abc import Iterable, Sequence
from typing import Any

from pygnmi.spec.v080 import gnmi_pb2 as gnmi

from qswitch_agent.telemetry.tree import Element, Large, Leaf, Path, Value

VERSION = "0.8.0"
ENCODINGS = (gnmi.JSON, gnmi.JSON_IETF, gnmi.PROTO)
DIGITS = 3  # of numbers with a fraction
MAX_ELEMENTS = 32


class Unusable(Exception):
    """A request that cannot be answered; the text names what, and what can be."""


def path_of(prefix: Any, path: Any) -> Path:
    """Return the path of a request, behind its prefix; raise Unusable for anything else."""
    elements = [*prefix.elem, *path.elem]
    if path.element or prefix.element:
        raise Unusable("the path is in `element`, of gNMI before 0.4: use `elem`")
    if len(elements) > MAX_ELEMENTS:
        raise Unusable(f"a path of {len(elements)} elements: at most {MAX_ELEMENTS}")
    return tuple(Element(element.name, tuple(sorted(element.key.items()))) for element in elements)


def require_encoding(encoding: int) -> None:
    """Raise Unusable for an encoding that is not spoken."""
    if encoding not in ENCODINGS:
        names = ", ".join(map(gnmi.Encoding.Name, ENCODINGS))
        raise Unusable(f"encoding {encoding}: choose one of {names}")


def notification(
    time_ns: int, leaves: Iterable[Leaf], encoding: int, gone: Sequence[Path] = ()
) -> Any:
    updates = [
        gnmi.Update(path=_encoded(leaf.path), val=_typed(leaf.value, encoding)) for leaf in leaves
    ]
    return gnmi.Notification(
        timestamp=time_ns, update=updates, delete=[_encoded(path) for path in gone]
    )


def _encoded(path: Path) -> Any:
    return gnmi.Path(elem=[gnmi.PathElem(name=name, key=dict(keys)) for name, keys in path])


def _typed(value: Value, encoding: int) -> Any:
    if encoding == gnmi.PROTO:
        if isinstance(value, str):
            return gnmi.TypedValue(string_val=value)
        if isinstance(value, int):
            return gnmi.TypedValue(uint_val=value)
        return gnmi.TypedValue(double_val=value)
    if encoding == gnmi.JSON_IETF:
        if isinstance(value, float):
            value = f"{value:.{DIGITS}f}"
        elif isinstance(value, Large):
            value = str(value)
        return gnmi.TypedValue(json_ietf_val=json.dumps(value).encode())
    return gnmi.TypedValue(json_val=json.dumps(value).encode())
