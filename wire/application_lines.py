"""Lines of JSON that applications of hosts print, and who follows them reads."""

import json
from collections.abc import Mapping
from typing import Any, cast

from wire import typed_json
from wire.results.figures import ServiceFigures
from wire.results.moments import AnyMoment

Line = dict[str, Any]  # `event`, and what belongs to it
NOT_FIGURES = ("event", "peer", "sha256")


def fields_of(line: str | bytes) -> Line:
    """Return the object of a line, {} for a line that is not one: the interpreter also warns."""
    try:
        fields = json.loads(line)
    except (ValueError, RecursionError):
        return {}
    return fields if isinstance(fields, dict) else {}


def figures(line: Mapping[str, Any]) -> ServiceFigures:
    """Return what an end has said of a service; raise MalformedPacket for anything else."""
    values = {name: value for name, value in line.items() if name not in NOT_FIGURES}
    return cast("ServiceFigures", typed_json.read(cast("Any", ServiceFigures), values))


def moment(line: Mapping[str, Any], at_s: float) -> AnyMoment:
    """Return what has happened at a time of the run; raise MalformedPacket for anything else."""
    values = {**line, "at": round(at_s, 3)}
    return cast("AnyMoment", typed_json.read(cast("Any", AnyMoment), values))
