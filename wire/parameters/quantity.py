"""Numbers as people write them for an option that has a unit: 5, or with a unit: 5km, 100ms, 2dB.

The option says its unit (wire.parameters.option.unit_of); a number without one is of that unit, and
one with another unit of the same kind is converted: --length-km 500m.
"""

import re
from collections.abc import Mapping
from decimal import Decimal
from types import MappingProxyType

from wire.parameters.checks import share

NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d{1,3})?"
MICRO = str.maketrans("\u00b5\u03bc", "uu")  # the sign, and the Greek letter
WRITTEN = re.compile(rf"({NUMBER})\s*([^\d\s].*)")


def _powers(unit: str, **prefixes: int) -> dict[str, Decimal]:
    return {f"{prefix.strip('_')}{unit}": Decimal(10) ** n for prefix, n in prefixes.items()}


# Units of one kind, each by how much of the first it is.
KINDS: tuple[Mapping[str, Decimal], ...] = tuple(
    MappingProxyType(kind)
    for kind in (
        {
            **_powers("s", _=0, m=-3, u=-6, n=-9, p=-12),
            "min": Decimal(60),
            "h": Decimal(3600),
        },
        _powers("m", _=0, k=3, c=-2, m=-3, u=-6, n=-9, p=-12),
        _powers("Hz", _=0, k=3, M=6, G=9, T=12),
        _powers("bit/s", _=0, k=3, M=6, G=9),
        _powers("W", _=0, m=-3, u=-6, n=-9),
        {
            **_powers("bytes", _=0),
            **_powers("B", _=0, k=3, M=6, G=9),
            **{f"{prefix}iB": Decimal(1024) ** n for n, prefix in enumerate("KMG", 1)},
        },
    )
)


def quantity(unit: str, text: str, kind: type[int] | type[float]) -> float:
    """Return the number of an option with a unit, or ""; raise ValueError for other texts."""
    try:
        return kind(text)
    except ValueError:
        number = _with_unit(unit, text)
    if number is None or (kind is int and number != int(number)):
        whole = "whole " if kind is int else ""
        written = f" of {unit}, as 5 or 5{unit}" if unit else ""
        raise ValueError(f"{text!r}: choose a {whole}number{written}{share(text)}")
    return kind(number)


def _with_unit(unit: str, text: str) -> Decimal | None:
    """Return a number in a unit, None for a text that is no number of its kind."""
    text = text.strip().translate(MICRO)
    if re.fullmatch(NUMBER, text):
        return Decimal(text)  # 1e6, for a whole number
    if not unit or not (written := WRITTEN.fullmatch(text)):
        return None
    number, unit_written = Decimal(written[1]), written[2]
    if unit_written == unit:
        return number
    for kind in KINDS:
        if unit in kind and unit_written in kind:
            return number * kind[unit_written] / kind[unit]
    return None
