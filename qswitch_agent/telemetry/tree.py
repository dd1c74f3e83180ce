"""Paths and values of telemetry as gNMI has them: leaves of a tree, found by paths with wildcards.

gNMI specification 0.8, sections 2.2.2 (paths) and 2.3 (values); gNMI path conventions (wildcards).
"""

from collections.abc import Sequence
from typing import NamedTuple

ANY, ANY_MANY = "*", "..."


class Element(NamedTuple):
    """One step of a path: a node's name, and the keys of an entry of a list."""

    name: str
    keys: tuple[tuple[str, str], ...] = ()

    def matches(self, other: "Element") -> bool:
        """Tell whether another step, without wildcards, is one that this names.

        Modules before a name (`openconfig-platform:components`) need not be said; a key that is
        not said stands for all.
        """
        if self.name != ANY and self.name.rpartition(":")[2] != other.name.rpartition(":")[2]:
            return False
        own = dict(other.keys)
        return all(value == ANY or own.get(key) == value for key, value in self.keys)


Path = tuple[Element, ...]


class Large(int):
    """A number of 64 bits, which JSON of the IETF writes as a string (RFC 7951, 6.1)."""


Value = str | int | float


class Leaf(NamedTuple):
    """A value, and where it is."""

    path: Path
    value: Value


def found(leaves: Sequence[Leaf], path: Path) -> list[Leaf]:
    return [leaf for leaf in leaves if _is_below(leaf.path, path)]


def _is_below(place: Path, path: Path) -> bool:
    if not path:
        return True
    first, rest = path[0], path[1:]
    if first.name == ANY_MANY:
        return any(_is_below(place[start:], rest) for start in range(len(place) + 1))
    return bool(place) and first.matches(place[0]) and _is_below(place[1:], rest)
