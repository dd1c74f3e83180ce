"""Tables of what a network tells a script: HTML in a notebook, and data frames of pandas.

pandas is not among what qmn needs: `make notebooks` installs it, from notebooks.lock.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import fields
from typing import Any, TypeVar

from views.report import markup

T = TypeVar("T")
Row = Mapping[str, object]
SIMPLE = int, float, str, bool, type(None)
MISSING = "data frames need pandas: `make notebooks` installs it (pip install pandas)"


class Tabular:
    """Something that is a table of rows, each a value by column."""

    def rows(self) -> Sequence[Row]:
        """Return the rows: here one, of what is a number or a text."""
        return [row_of(self)]

    def to_dataframe(self) -> Any:
        """Return a pandas.DataFrame of the rows; raise ImportError where there is no pandas."""
        try:
            import pandas as pd
        except ImportError as error:
            raise ImportError(MISSING) from error
        return pd.DataFrame(list(self.rows()))

    def _repr_html_(self) -> str:
        """Return what a notebook shows."""
        rows = self.rows()
        heads = list(rows[0]) if rows else []
        return markup.table(heads, [[shown(row[head]) for head in heads] for row in rows])


class TableOf(list[T], Tabular):
    """A list of such things, each of which may be several rows."""

    def rows(self) -> Sequence[Row]:
        """Return the rows of all, one after the other."""
        return [row for each in self for row in rows_of(each)]


def rows_of(thing: object) -> Sequence[Row]:
    """Return the rows of a thing that is a table, or the one of another dataclass."""
    return thing.rows() if isinstance(thing, Tabular) else [row_of(thing)]


def row_of(thing: Any) -> Row:
    """Return the fields and properties of a dataclass that are a number or a text."""
    names = [field.name for field in fields(thing)]
    more = [name for name, made in vars(type(thing)).items() if isinstance(made, property)]
    every = ((name, getattr(thing, name)) for name in (*names, *more))
    return {name: value for name, value in every if isinstance(value, SIMPLE)}


def shown(value: object) -> str:
    """Return a value for a person: numbers with what one wants to read of them."""
    if value is None:
        return "-"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int):
        return f"{value:,}"
    return f"{value:,.4g}" if isinstance(value, float) else str(value)


def drawn(html: str, style: str) -> str:
    """Return figures of a report for a page that is not one: with the colours of its style."""
    colours = " ".join(f"--{name}: {value};" for name, value in _colours(style).items())
    return f'<div style="{colours} background: var(--paper)">{html}</div>'


def file_of(svg: str, style: str) -> str:
    """Return a figure of a report as a file of its own: with colours in place of their names."""
    colours = _colours(style)
    named = re.sub(r"var\(--([\w-]+)\)", lambda match: colours[match[1]], svg)
    return named.replace("<svg ", '<svg xmlns="http://www.w3.org/2000/svg" ', 1)


def _colours(style: str) -> dict[str, str]:
    """Return the variables of a page in light colours, by name."""
    (block,) = re.findall(r":root \{\n(.*?)\n\}", style[: style.index("@media")], re.DOTALL)
    return dict(re.findall(r"--([\w-]+):\s*([^;]+);", block))
