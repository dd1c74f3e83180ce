"""The experiments by name, as experiments.toml declares them."""

import asyncio
import tomllib
from collections.abc import Callable, Coroutine, Mapping
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any

from evidence.curves import link
from evidence.curves.experiment import Experiment, Measure, Outcome
from evidence.curves.parameters import BadGrid, Point, Values, declared, point_seed
from wire.parameters.checks import check_names

KEYS = "what", "run", "theory", "link", "parameters", "measures", "logarithmic"
_DECLARED = tomllib.loads(Path(__file__).with_name("experiments.toml").read_text())


def _experiment(name: str, content: Mapping[str, Any]) -> Experiment:
    check_names(f"experiment {name}", content, KEYS, BadGrid)
    parameters = [declared(*each) for each in content["parameters"].items()]
    is_link, logarithmic = "link" in content, content.get("logarithmic", ())
    return Experiment(
        name,
        content["what"],
        (*(link.LINK if is_link else ()), *parameters),
        tuple(
            Measure(each, label, partial(_expected, name, each), each in logarithmic)
            for each, label in content["measures"].items()
        ),
        link.implied if is_link else lambda _given: {},
    )


def _expected(name: str, measure: str, values: Values) -> float | None:
    if "theory" not in _DECLARED[name]:
        return None
    theory: Callable[[Point], Mapping[str, float | None]] = _function(name, "theory")
    return theory(Point(values))[measure]


def _function(name: str, key: str) -> Callable[..., Any]:
    """Return a function of an experiment; its module is loaded when it is used."""
    module, _, function = _DECLARED[name][key].partition(".")
    entry: Callable[..., Any] = getattr(import_module(f"evidence.curves.{module}"), function)
    return entry


EXPERIMENTS = {name: _experiment(name, given) for name, given in _DECLARED.items()}


def measure(name: str, values: Values, seed: int) -> dict[str, tuple[float, float]]:
    """Run an experiment at one point; return value and standard error of each measure.

    Outcomes depend on the experiment, the values and the seed alone: not
    on the machine, nor on which points were measured before. This is what workers are asked.
    """
    run: Callable[[Point, int], Coroutine[None, None, Outcome]] = _function(name, "run")
    outcome = asyncio.run(run(Point(values), point_seed(name, values, seed)))
    return {key: (estimate.value, estimate.error) for key, estimate in outcome.items()}
