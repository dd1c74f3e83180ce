"""Values of a NetQASM program as JSON: its outcomes are Futures, which JSON would write as 0."""

import json
from dataclasses import fields, is_dataclass
from typing import Any

from netqasm.sdk.futures import BaseFuture


def resolved(value: Any) -> Any:
    """Return a value with the number of each Future in it; raise NoValueError if one has none.

    A Future is an int whose own number, which JSON, `%d` and indices use, is always 0.
    """
    if isinstance(value, BaseFuture):
        return int(value)
    if is_dataclass(value) and not isinstance(value, type):
        value = {field.name: getattr(value, field.name) for field in fields(value)}
    if isinstance(value, dict):
        return {resolved(name): resolved(each) for name, each in value.items()}
    if isinstance(value, tuple):  # also as the name in a dictionary
        return tuple(map(resolved, value))
    return [*map(resolved, value)] if isinstance(value, list | set | frozenset) else value


def plain(output: Any) -> Any:
    """Return what JSON can hold of an output: a complex number as its two parts, others as text."""
    return json.loads(json.dumps(resolved(output), default=_substitute))


def _substitute(value: Any) -> Any:
    if isinstance(value, complex):
        return [value.real, value.imag]
    if hasattr(value, "tolist"):  # of numpy, which may hold objects
        return resolved(value.tolist())
    return str(value)
