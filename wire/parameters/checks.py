"""The checks of every configuration: of names that are known, of choices, of ranges.

Options of programs and networks, parameters of physics, keywords of nodes and links, the
controller's policy, settings of devices and options of sessions are refused in the same words, by
an error of each one's own kind.
"""

from collections.abc import Callable, Collection, Iterable
from difflib import get_close_matches
from math import inf
from typing import Any

NEAR = "did you mean"
MOST_EDITS = 2
Refusal = Callable[[str], Exception]  # makes the error of a text


def remedy(name: str, names: Collection[str], listed: Collection[str] = ()) -> str:
    """Return a suggestion for an unknown name: the nearest one, or else any listed."""
    if near := nearest(name, names):
        return f"{NEAR} {near}?"
    choices = listed or names
    return f"choose one of {', '.join(choices)}" if choices else "there are none"


def nearest(name: str, names: Collection[str]) -> str:
    """Return the known name that is meant, "" for none: a slip, never another word.

    A slip leaves the first letter, and changes two at most or leaves off what follows:
    requesters is none of repeaters.
    """
    alike = [each for each in names if each.lower() == name.lower()]
    near = [
        each
        for each in get_close_matches(name, names)
        if each[0] == name[0]
        and (each.startswith(name) or name.startswith(each) or _edits(name, each) <= MOST_EDITS)
    ]
    return next(iter([*alike, *near]), "")


def _edits(one: str, other: str) -> int:
    """Return how many letters are added, left out or changed at least (Levenshtein)."""
    row: list[int] = [*range(len(other) + 1)]
    for i, letter in enumerate(one, 1):
        before, row = row, [i]
        for j, instead in enumerate(other, 1):
            changed = before[j - 1] + (letter != instead)
            row.append(min(before[j] + 1, row[-1] + 1, changed))
    return row[-1]


def check_names(
    where: str, names: Iterable[str], choices: Collection[str], refusal: Refusal = ValueError
) -> None:
    """Refuse the first name, in their order, that is not known; `where` has names."""
    for name in sorted(set(names) - set(choices)):
        raise refusal(f"{where} has no {name}: {remedy(name, choices)}")


def check_choice(
    what: str, value: Any, choices: Collection[str], refusal: Refusal = ValueError
) -> None:
    if not isinstance(value, str) or value not in choices:
        word = value if isinstance(value, str) else ""
        raise refusal(f"{what} {value!r}: {remedy(word, choices)}")


def check_number(
    what: str,
    value: Any,
    least: float,
    most: float,
    refusal: Refusal = ValueError,
    meaning: str = "",
) -> None:
    """Refuse what is not a number in this range; a whole one, if the range begins with one.

    Anything that says True or False is not a number, and NaN is in no range.
    """
    whole = isinstance(least, int)
    kinds = int if whole else (int, float)
    if isinstance(value, bool) or not isinstance(value, kinds) or not least <= value <= most:
        meaning = meaning or ("a whole number" if whole else "")
        text = f" ({meaning})" if meaning else ""
        raise refusal(f"{what} {value!r}: choose {range_words(least, most)}{text}")


def share(text: str) -> str:
    """Return what to write for a percentage, `2%`, as the end of an error; of other text, none."""
    try:
        return f": write {float(text[:-1]) / 100:g}" if text.endswith("%") else ""
    except ValueError:
        return ""


def range_words(least: float, most: float) -> str:
    return f"{_number(least)} or more" if most == inf else f"{_number(least)} to {_number(most)}"


def _number(value: float) -> str:
    return str(value) if isinstance(value, int) else f"{value:g}"
