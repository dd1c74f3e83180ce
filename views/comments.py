"""The comments of fields, where they are declared: what reference pages say of a field.

A field's comment stands behind it, or on the lines above it, as everywhere in this tree.
"""

import ast
import inspect
import io
import textwrap
import tokenize
import tomllib
from dataclasses import is_dataclass
from functools import cache
from pathlib import Path
from typing import Any, get_args, get_type_hints


@cache
def of_fields(kind: type) -> dict[str, str]:
    """Return the comment of each field of a class and of its bases, by name; "" for none."""
    comments: dict[str, str] = {}
    for base in reversed(kind.__mro__):
        if base.__module__ != "builtins" and "__annotations__" in vars(base):
            comments |= _own(base)
    return comments


def _own(kind: type) -> dict[str, str]:
    source = textwrap.dedent(inspect.getsource(kind))
    (tree,) = ast.parse(source).body
    assert isinstance(tree, ast.ClassDef)
    comments = _by_line(source)
    return {
        node.target.id: _comment(node, comments)
        for node in tree.body
        if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name)
    }


def _by_line(source: str) -> dict[int, tuple[int, str]]:
    tokens = tokenize.generate_tokens(io.StringIO(source).readline)
    lines = source.splitlines()
    return {
        token.start[0]: (
            token.start[1] if not lines[token.start[0] - 1][: token.start[1]].strip() else -1,
            token.string.lstrip("# "),
        )
        for token in tokens
        if token.type == tokenize.COMMENT
    }


def _comment(node: ast.AnnAssign, comments: dict[int, tuple[int, str]]) -> str:
    """Return what stands on the lines above a field, and then behind it."""
    above = list[str]()
    line = node.lineno - 1
    while line in comments and comments[line][0] >= 0:
        above.insert(0, comments[line][1])
        line -= 1
    behind = [
        comments[number][1]
        for number in range(node.lineno, (node.end_lineno or node.lineno) + 1)
        if number in comments
    ]
    return " ".join([*above, *behind])


MEANINGS = Path(__file__).with_name("field_meanings.toml")


RESULTS, MESSAGES = "results", "messages"  # what its names are of


@cache
def _meanings() -> dict[str, dict[str, str]]:
    meanings: dict[str, dict[str, str]] = tomllib.loads(MEANINGS.read_text())
    return meanings


def meaning(kind: type, name: str, of: str = RESULTS) -> str:
    """Return what a field means: its comment, or that of its name; "" for neither."""
    return of_fields(kind).get(name) or by_name(name, of)


def by_name(name: str, of: str = MESSAGES) -> str:
    return _meanings()[of].get(name, "")


def dataclasses_in(kind: Any) -> dict[str, type]:
    classes: dict[str, type] = {}
    left = [kind]
    while left:
        each = left.pop()
        if isinstance(each, type) and is_dataclass(each) and each.__name__ not in classes:
            classes[each.__name__] = each
            left += get_type_hints(each).values()
        left += get_args(each)
    return classes
