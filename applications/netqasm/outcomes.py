"""Values of a NetQASM program as JSON: its outcomes are Futures, which JSON would write as 0."""

import json
from collections.abc import Callable
from dataclasses import fields, is_dataclass
from operator import attrgetter
from typing import Any

from netqasm.sdk.futures import BaseFuture

VALUE = attrgetter("value")  # of a Future: a number or None


def resolved(value: Any, read: Callable[[BaseFuture], int | None] = int) -> Any:
    """Return a value with the number of each Future in it; raise NoValueError if one has none.

    A Future is an int whose own number, which JSON, `%d` and indices use, is always 0.
    """
    if isinstance(value, BaseFuture):
        return read(value)
    if is_dataclass(value) and not isinstance(value, type):
        value = {field.name: getattr(value, field.name) for field in fields(value)}
    if isinstance(value, dict):
        return {resolved(name, read): resolved(each, read) for name, each in value.items()}
    if isinstance(value, list | tuple | set | frozenset):
        kind = tuple if isinstance(value, tuple) else list  # a tuple may name an entry
        return kind(resolved(each, read) for each in value)
    return value


def plain(output: Any) -> Any:
    """Return what JSON can hold of an output: a complex number as its two parts, others as text.

    A Future without a number, as one of a branch that was not taken, becomes None.
    """
    return json.loads(json.dumps(resolved(output, VALUE), default=_substitute))


def _substitute(value: Any) -> Any:
    if isinstance(value, complex):
        return [value.real, value.imag]
    if hasattr(value, "tolist"):  # of numpy, which may hold objects
        return resolved(value.tolist(), VALUE)
    return str(value)
