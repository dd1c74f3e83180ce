"""The drawing of a handshake: what is red, where times begin, on which side words are."""

import re
from itertools import pairwise

import pytest

from views.report import drawing
from views.report.handshake_diagram import handshake_diagram
from views.report.sequence import METADATA, OPENFLOW, QUANTUM, Step

NAMES = ("alice", "bob", "c0")
BEGIN_NS = 1_700_000_000 * 10**9


def step(layer: str, at_ns: int = 0, text: str = "x", to: str = "bob", took: int = -1) -> Step:
    """Return something that alice sends, and that arrives if it takes a time."""
    at = BEGIN_NS + at_ns
    return Step(layer, "alice", at, text, to, None if took < 0 else at + took)


def red(drawn: str) -> bool:
    return f"var(--{drawing.VARIABLES[drawing.BAD]})" in drawn


def words(drawn: str) -> dict[str, tuple[float, str]]:
    """Return how far from the left each text is, and which side of it that is, by its words."""
    found = re.findall(r'text-anchor: (\w+);[^>]*x="([\d.]+)"[^>]*>([^<]*)<', drawn)
    return {text: (float(x), anchor) for anchor, x, text in found}


@pytest.mark.parametrize(
    ("layer", "took", "lost"),
    [
        (METADATA, -1, True),
        (METADATA, 5, False),
        (OPENFLOW, -1, False),  # of these only the sending is captured
        (QUANTUM, -1, False),
        (QUANTUM, 5, False),
    ],
)
def test_messages_of_hosts_that_never_arrive_are_red_and_nothing_else(
    layer: str, took: int, lost: bool
) -> None:
    assert red(handshake_diagram([step(layer, took=took)], NAMES)) == lost


def test_what_a_host_does_alone_is_not_lost() -> None:
    assert not red(handshake_diagram([step(METADATA, to="")], NAMES))


@pytest.mark.parametrize(
    ("second_ns", "times"),
    [
        (999_999, ["0.000 µs", "999.999 µs"]),
        (1_000_000, ["0.000 ms", "1.000 ms"]),
        (2_500_000_000, ["0.000 ms", "2500.000 ms"]),
    ],
)
def test_times_begin_at_the_first_moment_in_the_unit_of_the_last(
    second_ns: int, times: list[str]
) -> None:
    drawn = handshake_diagram([step(QUANTUM, to=""), step(QUANTUM, second_ns, to="")], NAMES)
    assert re.findall(r"[\d.]+ [mµ]s", drawn) == times


def test_words_are_on_the_side_to_which_something_goes_and_inside_the_drawing() -> None:
    back = Step(METADATA, "bob", BEGIN_NS, "answer", "alice", BEGIN_NS)
    long = "w" * 60  # wider than what is right of c0
    steps = [step(METADATA, text="there"), back, step(QUANTUM, text="here", to="")]
    steps += [Step(QUANTUM, "c0", BEGIN_NS, text) for text in ("short", long)]
    drawn = words(handshake_diagram(steps, NAMES))
    places = {name: drawn[name][0] for name in NAMES}
    assert all(places[one] < places[other] for one, other in pairwise(NAMES))
    assert drawn.keys() > {"there", "answer", "here", "short", long}
    for text, name, anchor in (
        ("there", "alice", "start"),
        ("answer", "bob", "end"),
        ("here", "alice", "start"),
        ("short", "c0", "start"),
        (long, "c0", "end"),
    ):
        assert drawn[text][1] == anchor, text
        assert (drawn[text][0] > places[name]) == (anchor == "start"), text
