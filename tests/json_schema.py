"""A reader of JSON Schema for tests: the keywords that our schemas use, as draft 2020-12 has them.

Any other keyword is an error, so that none goes unchecked.
"""

from collections.abc import Iterator
from typing import Any

KINDS: dict[str, type | tuple[type, ...]] = {
    "string": str,
    "boolean": bool,
    "integer": int,
    "number": (int, float),
    "null": type(None),
    "array": list,
    "object": dict,
}
KNOWN = {"$ref", "oneOf", "anyOf", "type", "items", "properties", "required", "$schema", "$defs"}
KNOWN |= {"additionalProperties", "unevaluatedProperties", "allOf", "title", "description"}


def problems(value: Any, schema: dict[str, Any], root: dict[str, Any], at: str = "") -> list[str]:
    """Return what of a value does not fit, each with its place."""
    assert schema.keys() <= KNOWN, schema.keys() - KNOWN
    return [*_problems(value, schema, root, at)]


def _problems(value: Any, schema: dict[str, Any], root: dict[str, Any], at: str) -> Iterator[str]:
    if "$ref" in schema:
        name = schema["$ref"].removeprefix("#/$defs/")
        yield from problems(value, root["$defs"][name], root, at)
    for word, most in (("oneOf", 1), ("anyOf", len(schema.get("anyOf", ())))):
        found = [problems(value, each, root, at) for each in schema.get(word, ())]
        if found and not 1 <= sum(not each for each in found) <= most:
            yield from min(found, key=len) or [f"{at}: several of {word} fit"]
    for each in schema.get("allOf", ()):
        yield from problems(value, each, root, at)
    kind = schema.get("type")
    if kind is None:
        return
    fits: bool = isinstance(value, KINDS[kind])
    if not fits or (kind != "boolean" and type(value) is bool):
        yield f"{at}: {value!r} is not of type {kind}"
    elif kind == "array":
        for number, each in enumerate(value):
            yield from problems(each, schema["items"], root, f"{at}/{number}")
    elif kind == "object":
        yield from _of_object(value, schema, root, at)


def _properties(schema: dict[str, Any], root: dict[str, Any]) -> set[str]:
    """Return the properties that a schema names, also by way of those that hold, too."""
    if "$ref" in schema:
        return _properties(root["$defs"][schema["$ref"].removeprefix("#/$defs/")], root)
    named = (_properties(each, root) for each in schema.get("allOf", ()))
    return {*schema.get("properties", ())}.union(*named)


def _of_object(
    value: dict[str, Any], schema: dict[str, Any], root: dict[str, Any], at: str
) -> Iterator[str]:
    for name in set(schema.get("required", ())) - value.keys():
        yield f"{at}/{name} is missing"
    rest = schema.get("additionalProperties", {})
    if schema.get("unevaluatedProperties") is False:
        for name in value.keys() - _properties(schema, root):
            yield f"{at}/{name} is unknown"
    for name, each in value.items():
        own = schema.get("properties", {}).get(name, rest)
        if own is False:
            yield f"{at}/{name} is unknown"
        else:
            yield from problems(each, own, root, f"{at}/{name}")
