"""Keywords of nodes and links: one that nobody takes is refused by name, and not swallowed.

Mininet hands every keyword on and drops those that nobody knows, so that a slip of the pen would
start another network than the one that was described.
"""

import inspect
from collections.abc import Iterable, Iterator
from functools import cache

from wire.parameters.checks import remedy
from wire.parameters.physics import BadParameter

# What Mininet passes or looks up without naming it in a signature.
FROM_MININET = {"name", "cls", "isSwitch", "privateDirs", "waitExited", "cores", "intfName"}
NAMED = (inspect.Parameter.POSITIONAL_OR_KEYWORD, inspect.Parameter.KEYWORD_ONLY)


def refuse_unknown(
    where: str, names: Iterable[str], *kinds: type, also: Iterable[str] = ()
) -> None:
    """Raise BadParameter for keywords that none of these classes takes to be made or configured.

    `also` are others that are known. The error names those that are not Mininet's, if any are.
    """
    classes = [base for kind in kinds for base in kind.__mro__ if not _is_mininets(base)]
    ours = {*also, *_taken(classes)}
    keywords = {*ours, *FROM_MININET, *_taken(base for kind in kinds for base in kind.__mro__)}
    for name in sorted(set(names) - keywords):
        choices = sorted((ours or keywords) - {"name", "node1", "node2"})
        raise BadParameter(f"{where} has no {name}: {remedy(name, sorted(keywords), choices)}")


def _is_mininets(kind: type) -> bool:
    return kind.__module__.split(".")[0] == "mininet"


def _taken(kinds: Iterable[type]) -> Iterator[str]:
    for kind in kinds:
        yield from _taken_by(kind)


@cache
def _taken_by(kind: type) -> list[str]:
    methods = (vars(kind).get(name) for name in ("__init__", "config"))
    signatures = [inspect.signature(method) for method in methods if inspect.isfunction(method)]
    named = [one for signature in signatures for one in [*signature.parameters.values()][1:]]
    return [one.name for one in named if one.kind in NAMED]
