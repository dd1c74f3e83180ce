"""The parameters of an experiment, and the values that a user gives them.

A value is typed as 0.1, several as 0.1,0.2,0.5, evenly spaced ones as from:to:count, and
1e-3:1:7:log is evenly spaced on a logarithmic scale.
"""

import json
import math
import re
from dataclasses import dataclass, fields
from hashlib import blake2b
from typing import Any

import numpy as np

from wire.parameters.checks import share
from wire.parameters.option import UNITS, unit_of
from wire.parameters.quantity import quantity

Value = float | int | str
Values = dict[str, Value]

MAX_VALUES = 10_000
RANGE = re.compile(r"([\d.]+)-([\d.]+)")  # as people write one


class Point(dict[str, Value]):
    """Values of an experiment's parameters; numbers are attributes, too."""

    def __getattr__(self, name: str) -> float:
        if name not in self:
            raise AttributeError(name)
        return float(self[name])


class BadGrid(ValueError):
    """A grid that cannot be; the message names parameter, value and range."""


@dataclass(frozen=True)
class Parameter:
    """A number from `least` to `most`, whole if these are, one of the choices, or any text."""

    name: str
    default: Value
    least: float = 0.0
    most: float = 1.0
    unit: str = ""
    choices: tuple[str, ...] = ()
    text: str = ""  # what any text names; empty: it is not a text

    @property
    def whole(self) -> bool:
        """Whether only whole numbers will do."""
        return isinstance(self.least, int)

    @property
    def range(self) -> str:
        """The allowed values, in words."""
        if self.text:
            return self.text
        if self.choices:
            return f"choose {', '.join(self.choices)}"
        number = " (a whole number)" if self.whole else ""
        if self.least == -math.inf:
            return f"choose a number{f' of {self.unit}' if self.unit else ''}"
        unit = f" {self.unit}" if self.unit else ""
        if self.most == math.inf:
            return f"choose {self.least:g}{unit} or more{number}"
        return f"choose {self.least:g} to {self.most:g}{unit}{number}"

    @property
    def label(self) -> str:
        return f"{self.words} ({self.unit})" if self.unit else self.words

    @property
    def words(self) -> str:
        """Return the name without the unit."""
        endings = (ending for ending, unit in UNITS if unit == self.unit)
        return self.name.removesuffix(next(endings, "")).replace("_", " ")

    def formatted(self, value: Value) -> str:
        number = f"{value:g}" if isinstance(value, float) else f"{value}"
        return f"{self.words} {number} {self.unit}".rstrip()

    def value(self, content: object) -> Value:
        """Return a value of the right type; raise BadGrid for one that cannot be."""
        if self.text and isinstance(content, str):
            return content
        if self.choices:
            if content not in self.choices:
                raise self._bad(content)
            return str(content)
        if isinstance(content, bool) or not isinstance(content, (int, float, str)):
            raise self._bad(content)
        try:
            number = quantity(self.unit, str(content), float)
        except ValueError:
            raise self._bad(content) from None
        if not self.least <= number <= self.most or (self.whole and not number.is_integer()):
            raise self._bad(content)
        return int(number) if self.whole else number

    def axis(self, value: object) -> list[Value]:
        """Return the values that text, a number, a list or a table asks for, each once."""
        values = [self.value(each) for each in self._spread(value)]
        if not values:
            raise BadGrid(f"{self.name} has no value: {self.range}")
        return list(dict.fromkeys(values))

    def _spread(self, value: object) -> list[Any]:
        if isinstance(value, list):
            return value
        if isinstance(value, dict):
            return self._spaced_by_table(value)
        if not isinstance(value, str) or (self.choices and ":" not in value and "," not in value):
            return [value]
        if ":" in value and not self.choices and not self.text:
            return self._spaced(value)
        return value.split(",")

    def _spaced_by_table(self, table: dict[str, Any]) -> list[float]:
        keys = {"from", "to", "points", "log"}
        if not {"from", "to", "points"} <= table.keys() <= keys:
            raise BadGrid(f"{self.name} {table}: say from, to and points, and log if you like")
        text = f"{table['from']}:{table['to']}:{table['points']}"
        return self._spaced(text + (":log" if table.get("log") else ""))

    def _spaced(self, text: str) -> list[float]:
        parts = text.split(":")
        if self.whole and len(parts) == 2:  # 1:8 are all of these
            least, most = (int(self.value(part)) for part in parts)
            if not least < most < least + MAX_VALUES:
                raise BadGrid(f"{self.name} {text}: write the smaller one first, as 1:8")
            return [*range(least, most + 1)]
        logarithmic = parts[3:] == ["log"]
        if len(parts) != (4 if logarithmic else 3):
            raise BadGrid(f"{self.name} {text}: write from:to:count or from:to:count:log")
        first, last = (float(self.value(part)) for part in parts[:2])
        count = Parameter(f"{self.name} {text}: count", 2, 2, MAX_VALUES).value(parts[2])
        if logarithmic and (first <= 0 or last <= 0):
            raise BadGrid(f"{self.name} {text}: a logarithmic scale has no 0")
        spaced = (np.geomspace if logarithmic else np.linspace)(first, last, int(count))
        spaced = np.rint(spaced) if self.whole else spaced
        # .3 as typed shall not become .30000000000000004.
        return [float(f"{number:.12g}") for number in spaced]

    def _bad(self, value: object) -> BadGrid:
        text = value if isinstance(value, str) else ""
        between = RANGE.fullmatch(text)
        remedy = f": write {between[1]}:{between[2]}:11" if between else share(text)
        numbers = not self.choices and not self.text and not self.whole
        return BadGrid(f"{self.name} {value!r}: {self.range}{remedy if numbers else ''}")


def declared(name: str, value: Any) -> Parameter:
    """Return a parameter as experiments.toml has it.

    A number is the default from 0 to 1; a list has default, least, most, and a unit that the name
    does not say. A list of texts has the choices, the default first; a table has other fields.
    """
    if isinstance(value, dict):
        choices = tuple(value.get("choices", ()))
        return Parameter(name, value["default"], choices=choices, text=value.get("text", ""))
    if not isinstance(value, list):
        return Parameter(name, value, unit=unit_of(name))
    if isinstance(value[0], str):
        return Parameter(name, value[0], choices=tuple(value))
    return Parameter(name, *value[:3], *value[3:] or [unit_of(name)])


def of_dataclass(prefix: str, device: Any) -> list[Parameter]:
    parameters = []
    for field in fields(device):
        name, default = f"{prefix}{field.name}", getattr(device, field.name)
        if default is None:
            continue
        if "choices" in field.metadata:
            parameters.append(Parameter(name, default, choices=field.metadata["choices"]))
        elif "range" in field.metadata:
            least, most = field.metadata["range"]
            parameters.append(Parameter(name, default, least, most, unit_of(field.name)))
    return parameters


def point_seed(experiment: str, values: Values, seed: int) -> int:
    """Return the seed of one point of an experiment, 63 bits.

    Points are independent, and a larger grid repeats the smaller one.
    """
    text = json.dumps([experiment, sorted(values.items()), seed])
    return int.from_bytes(blake2b(text.encode(), digest_size=8).digest()) >> 1
