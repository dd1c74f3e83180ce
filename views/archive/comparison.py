"""Two runs beside each other: parameters, figures, and when what happened first."""

import json
from collections.abc import Container, Iterator, Mapping
from pathlib import Path
from typing import Any

from topologies.system.runs.runtime import EVENT_CAPTURE
from views.events.event_sources import recorded
from wire import typed_json
from wire.controller_lines import read_record
from wire.results import schema
from wire.results.run_result import RESULT, Message

Row = tuple[str, str, str]
COMPARED = ("service", "topology", "controller", "seed", "parameters")
DIGITS = 12  # of a digest, by which people tell messages apart
FROM_THE_START = ("open", "create", "send", "arrive", "store", "measure", "bell-measure", "close")


def parameters(one: Path, two: Path) -> list[Row]:
    first, second = ({**_plain(_result(run), COMPARED), **_sent(run)} for run in (one, two))
    return [row for row in _beside(first, second) if row[1] != row[2]]


def _sent(run: Path) -> dict[str, str]:
    message_fields = schema.head_of(_result(run)).job.get("message")
    if message_fields is None:
        return {}
    message = typed_json.read(Message, message_fields, "job.message")
    digest = message.sha256_sent
    identity = f"SHA-256 {digest[:DIGITS]}" if digest else Path(message.file).name
    return {"message": f"{message.bytes:,} bytes, {identity}"}


def figures(one: Path, two: Path) -> list[Row]:
    """Return all numbers that both results tell, and those that one alone does."""
    left_out = ("parameters", "network", "every_fiber", "devices", "seed", "captures")
    results = (_result(run) for run in (one, two))
    first, second = (
        _plain(result, [name for name in result if name not in left_out]) for result in results
    )
    names = {name for each in (first, second) for name, value in each.items() if _number(value)}
    return list(_beside(first, second, names))


def moments(one: Path, two: Path) -> list[Row]:
    """Return when each kind of thing first happened, in ms since the first set-up of a path."""
    first, second = map(_first_times, (one, two))
    order = sorted({**first, **second}, key=lambda name: first.get(name, second.get(name, 0.0)))
    return [(name, _ms(first.get(name)), _ms(second.get(name))) for name in order]


def _ms(value: float | None) -> str:
    return "-" if value is None else f"{value:.3f}"


def _first_times(run: Path) -> dict[str, float]:
    times: dict[str, int] = {}
    capture = run / EVENT_CAPTURE
    for event in recorded(capture, follow=False) if capture.exists() else ():
        if event.kind in FROM_THE_START:
            times.setdefault(event.kind, event.time_ns)
    for fact in read_record(run):
        if fact["event"] in ("granted", "refused", "torn_down"):
            times.setdefault(fact["event"].replace("_", " "), fact["time_ns"])
    origin = min(times.values(), default=0)
    return {name: (time_ns - origin) / 1e6 for name, time_ns in times.items()}


def _result(run: Path) -> dict[str, Any]:
    return typed_json.read(dict[str, Any], schema.decoded(run / RESULT))


def _plain(values: Mapping[str, Any], names: Any) -> dict[str, Any]:
    """Return values without depth: {"path_setup_ms": {"p50": 1}} is {"path_setup_ms p50": 1}."""
    by_name: dict[str, Any] = {}
    for name in names:
        value = values.get(name)
        if isinstance(value, Mapping):
            prefix = "" if name in ("parameters", "job") else f"{name} "
            by_name |= {f"{prefix}{key}": each for key, each in _plain(value, value).items()}
        elif isinstance(value, int | float | str | bool) or name in values:
            by_name[name] = value
    return by_name


def _number(value: Any) -> bool:
    return isinstance(value, int | float)


def _beside(
    first: Mapping[str, Any], second: Mapping[str, Any], names: Container[str] | None = None
) -> Iterator[Row]:
    for name in {**first, **second}:
        if names is None or name in names:
            yield name.replace("_", " "), _text(first.get(name)), _text(second.get(name))


def _text(value: Any) -> str:
    if value is None:
        return "-"
    if isinstance(value, float):
        return f"{value:.6g}"
    return value if isinstance(value, str) else json.dumps(value)
