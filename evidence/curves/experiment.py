"""An experiment: the measures that are taken at each point of a grid."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from evidence.curves.estimates import Estimate
from evidence.curves.parameters import BadGrid, Parameter, Point, Value, Values
from wire.parameters.checks import remedy

Outcome = dict[str, Estimate]


class SweepError(Exception):
    """Points cannot be measured; the text names cause and remedy."""


@dataclass(frozen=True)
class Measure:
    """One measured number: its axis label with unit, and what theory says of it, if anything."""

    name: str
    label: str
    theory: Callable[[Values], float | None] = lambda _values: None
    logarithmic: bool = False
    # Another measure of the experiment that it is drawn over; theory gets its value, too.
    over: Parameter | None = None
    given: Sequence[str] = ()  # other measures that theory takes; drawn over an axis all the same

    def place(self, values: Values, outcome: Outcome) -> Values:
        names = (*self.given, *([self.over.name] if self.over else []))
        return {**values, **{name: outcome[name].value for name in names}}

    def expected(self, values: Values, outcome: Outcome) -> float | None:
        """Return what theory says of the measure at a point, None if nothing."""
        return self.theory(self.place(values, outcome))


@dataclass(frozen=True)
class Experiment:
    """Measures over parameters, repeatable by a seed."""

    name: str
    what: str
    parameters: tuple[Parameter, ...]
    measures: tuple[Measure, ...]
    # Values implied by the given ones; the rest is at its default.
    implied: Callable[[Values], Values] = lambda _given: {}

    @property
    def file(self) -> str:
        """The name of its tables and figures."""
        return self.name

    def groups(self, points: Sequence[Values], _at_once: int) -> Iterator[Sequence[Values]]:
        """Yield points that follow each other on a network, for a number of networks at a time."""
        yield from ([values] for values in points)

    @property
    def names(self) -> list[str]:
        return [parameter.name for parameter in self.parameters]

    def parameter(self, name: str) -> Parameter:
        """Return a parameter; raise BadGrid for one that the experiment does not have."""
        for parameter in self.parameters:
            if parameter.name == name:
                return parameter
        raise BadGrid(f"{name} is not a parameter of {self.name}: {remedy(name, self.names)}")

    def measure(self, name: str) -> Measure:
        return next(measure for measure in self.measures if measure.name == name)

    def complete(self, values: Values) -> Point:
        defaults = {parameter.name: parameter.default for parameter in self.parameters}
        return Point({**defaults, **self.implied(values), **values})

    def place(self, values: Values) -> str:
        """Name a point by the parameters that are not at their defaults."""
        changed = (each.name for each in self.parameters if values[each.name] != each.default)
        settings = ", ".join(f"{name} {values[name]}" for name in changed)
        return f"{self.name} at {settings or 'its defaults'}"


def number(values: Values, name: str) -> float:
    value: Value = values[name]
    return float(value)
