"""The network that a sweep emulates, and the hosts between which it measures."""

from collections.abc import Sequence
from typing import Any

from evidence.curves.parameters import Parameter, Values

TOPOLOGY = Parameter("topology", "sdc", text="a name of `qmn run`, or FILE.py:CLASS")
MAP = Parameter("map", "", text="a known map or a file")
SENDER = Parameter("from", "alice", text="the host that asks")
RECEIVER = Parameter("to", "bob", text="the host that is asked")
PLACES = (TOPOLOGY, MAP, SENDER, RECEIVER)


def are_plain(values: Values) -> bool:
    """Return whether it is the network that theory knows: one switch, alice and bob."""
    return all(values[each.name] == each.default for each in PLACES)


def network(values: Values) -> dict[str, Any]:
    named, known_map = values[TOPOLOGY.name], values[MAP.name] or None
    unnamed = known_map is not None and named == TOPOLOGY.default
    return {"topology": "" if unnamed else named, "map": known_map}


def said_of_fibers(values: Values, parameters: Sequence[Parameter]) -> tuple[str, ...]:
    """Return what is said of every fibre, of other networks only what is not as by default.

    Theirs may have optics of their own, which their `build` need not let anybody change.
    """
    unsaid = left_to_network(parameters, values)
    return tuple(
        f"{each.name}={values[each.name]}" for each in parameters if each.name not in unsaid
    )


def left_to_network(parameters: Sequence[Parameter], values: Values) -> set[str]:
    """Return the parameters of fibres that other networks are not told: they have their own."""
    if are_plain(values):
        return set()
    return {each.name for each in parameters if values[each.name] == each.default}
