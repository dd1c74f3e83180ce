"""The first photons of a key session, one by one, as textbooks tabulate them."""

import csv
from collections.abc import Iterable
from io import StringIO
from typing import NamedTuple
from urllib.parse import quote

from views.report.markup import table
from wire.dispatcher_pb2 import Event
from wire.outcomes import BASES

VERBS = {"create": "sends", "resend": "reads", "measure": "measures"}
STATES = {"|0>": ("Z", "0"), "|1>": ("Z", "1"), "|+>": ("X", "0"), "|->": ("X", "1")}
UNKNOWN = "–"  # noqa: RUF001 (of light that was lost, or that eve left alone)


class Step(NamedTuple):
    """An action of one host on the first photons: the basis and bit of each."""

    text: str  # host and verb
    bases: tuple[str, ...]
    bits: tuple[str, ...]


def first_steps(events: Iterable[Event], ends: tuple[str, ...]) -> list[Step]:
    """Return the steps of the session that came first: those of its ends outermost."""
    by_action: dict[tuple[str, str], Event] = {}
    session = None
    for event in events:
        if event.first and event.kind in VERBS and session in (None, event.block.session):
            session = event.block.session
            by_action.setdefault((event.node, event.kind), event)
    steps = [
        (node, Step(f"{node} {VERBS[kind]}", *zip(*map(_parts, event.first), strict=True)))
        for (node, kind), event in by_action.items()
    ]
    between = [step for node, step in steps if node not in ends]
    outer = [step for end in ends for node, step in steps if node == end]
    return [outer[0], *between, *outer[1:]] if len(outer) > 1 else []


def first_photons(events: Iterable[Event], ends: tuple[str, ...]) -> str:
    """Return the table, and the link to it as CSV; "" if there are no such photons."""
    steps = first_steps(events, ends)
    if not steps:
        return ""
    verdicts = [
        _comparison(before, after)
        for before, after in zip(_pairs(steps[0]), _pairs(steps[-1]), strict=False)
    ]
    rows = [
        [f"{step.text}: {name}", *cells]
        for step in steps
        for name, cells in (("basis", step.bases), ("bit", step.bits))
    ]
    rows.append(["kept", *verdicts])
    heads = ["photon", *map(str, range(1, len(verdicts) + 1))]
    file = StringIO()
    csv.writer(file, lineterminator="\n").writerows(zip(heads, *rows, strict=False))
    link = f'<a download="first-photons.csv" href="data:text/csv,{quote(file.getvalue())}">CSV</a>'
    text = (
        f"Photons measured in the basis in which they were sent are kept; the rest are not. {link}"
    )
    made = table(heads, rows, "photons")
    return f"<section><h2>The first photons</h2><p>{text}</p>{made}</section>"


def _parts(text: str) -> tuple[str, str]:
    """Return basis and bit of a state, or of a basis and its outcome."""
    if text in STATES:
        return STATES[text]
    basis, _space, bit = text.partition(" ")
    return (basis, bit) if basis in BASES and bit in ("0", "1") else (UNKNOWN, UNKNOWN)


def _pairs(step: Step) -> Iterable[tuple[str, str]]:
    return zip(step.bases, step.bits, strict=True)


def _comparison(before: tuple[str, str], after: tuple[str, str]) -> str:
    if before[0] != after[0] or UNKNOWN in (*before, *after):
        return ""
    return "yes" if before[1] == after[1] else "wrong"
