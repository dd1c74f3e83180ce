"""The page of the public Python API, made from its modules: signatures and docstrings.

python -m views.api_reference > api.md; `make site` has it as a page.
"""

import inspect
import re
from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from enum import Enum
from importlib import import_module
from typing import Any

from views.comments import RESULTS, by_name, meaning
from views.reference import table

INTRODUCTION = """# The Python API

```python
from qmn.scripting import start
from qmn.topology import OpticalSwitch, QuantumHost, QuantumTopo
```

This page is made from the four public modules. All else in qmn may change without notice
([Versions](versions.md))."""
PUBLIC = ("qmn.scripting", "qmn.topology", "qmn.services", "qmn.physics")
ADDRESS = re.compile(r" at 0x[0-9a-f]+")
API = "api"  # what names of values are of, in field_meanings.toml


def page() -> str:
    return "\n\n".join(part for part in (INTRODUCTION, *modules()) if part) + "\n"


def public_names(module: str) -> list[str]:
    loaded = import_module(module)
    return sorted(getattr(loaded, "__all__", dir(loaded)))


def modules() -> Iterator[str]:
    for module in PUBLIC:
        loaded = import_module(module)
        yield f"## {module}"
        yield first_line(loaded)
        for name in public_names(module):
            yield from described(name, getattr(loaded, name))


def described(name: str, value: Any) -> Iterator[str]:
    """Yield the section of a class, a function or another value."""
    yield f"### {name}"
    if isinstance(value, type) and not issubclass(value, Enum):
        yield from class_described(name, value)
    elif inspect.isfunction(value):
        yield f"```python\n{name}{signature(value)}\n```"
        yield inspect.getdoc(value) or ""
    else:
        yield description(name, value)


def class_described(name: str, kind: type) -> Iterator[str]:
    yield description(name, kind)
    if is_dataclass(kind):
        rows = [
            (f"`{field.name}`", default(field), of_field(kind, field))
            for field in fields(kind)
            if not field.name.startswith("_")
        ]
        yield table(("field", "default", "meaning"), rows)
    for method, function in methods(kind):
        yield f"`{method}{signature(function)}`: {first_line(function)}"


def of_field(kind: type, field: Any) -> str:
    """Return what a field means: the help of an option, its comment, or that of its name."""
    text = field.metadata.get("help") or meaning(kind, field.name, API)
    return str(text or by_name(field.name, RESULTS))


def methods(kind: type) -> list[tuple[str, Any]]:
    """Return the public methods that a class, or a base of it in this tree, documents."""
    functions = inspect.getmembers(kind, inspect.isfunction)
    return [
        (name, function)
        for name, function in functions
        if not name.startswith("_")
        and function.__doc__
        and function.__module__.split(".")[0] != "mininet"
    ]


def description(name: str, value: Any) -> str:
    """Return the docstring of a value, or what its name means."""
    text = value.__doc__ if isinstance(value, type) else ""
    if text and not text.startswith(f"{name}("):  # of a dataclass without one
        return inspect.cleandoc(text)
    return by_name(name.lower(), API)


def default(field: Any) -> str:
    text = repr(field.default)
    return f"`{text}`" if "MISSING" not in text and len(text) < 40 else ""


def signature(value: Any) -> str:
    return ADDRESS.sub("", str(inspect.signature(value)))


def first_line(value: Any) -> str:
    return (inspect.getdoc(value) or "").partition("\n\n")[0].replace("\n", " ")


if __name__ == "__main__":
    print(page(), end="")
