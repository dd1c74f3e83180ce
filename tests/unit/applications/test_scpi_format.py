"""The words of a matrix switch, read strictly."""

import random
import re
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from typing import Any

import pytest

from applications.instruments.scpi_link import (
    GarbledReply,
    channels,
    is_error,
    pairs,
    read_connections,
    read_error,
    read_powers,
    read_states,
)

Reader = Callable[[str], Any]


def three_powers(text: str) -> list[float]:
    return read_powers(text, 3)


def three_states(text: str) -> list[str]:
    return read_states(text, 3)


GOOD: list[tuple[Reader, str, Any]] = [
    (read_connections, "(@1,2),(@17,18)", {1: 17, 2: 18}),
    (read_connections, "(@1, 2), (@17, 18)", {1: 17, 2: 18}),
    (read_connections, "(@),(@)", {}),
    (read_error, '0,"No error"', (0, "No error")),
    (read_error, '-222, "Data out of range;port 99"', (-222, "Data out of range;port 99")),
    (three_powers, "(-10.53,+0.0, -6.0e1)", [-10.53, 0.0, -60.0]),
    (three_states, "(E, D,F)", ["E", "D", "F"]),
]


@pytest.mark.parametrize(("read", "text", "meaning"), GOOD)
def test_a_reply_is_read(read: Reader, text: str, meaning: object) -> None:
    assert read(text) == meaning


def test_a_reply_with_any_character_more_is_read_or_garbled() -> None:
    """A separator of ASCII, 0x1c to 0x1f, is a space to str.strip and re, and none to float."""
    for read, text, _meaning in GOOD:
        for place in range(len(text) + 1):
            for code in range(256):
                with suppress(GarbledReply):
                    read(text[:place] + chr(code) + text[place:])
    for read, text in ((three_powers, "(0,-10.5\x1f,0)"), (three_states, "(E,D\x1d,F)")):
        with pytest.raises(GarbledReply):
            read(text)


@pytest.mark.parametrize(
    ("read", "text"),
    [
        (three_powers, "(nan,0,0)"),
        (three_powers, "(inf,0,0)"),
        (three_powers, "(1_0,0,0)"),
        (three_powers, "(0,0)"),
        (three_powers, "0,0,0"),
        (three_states, "(E,E)"),
        (three_states, "(E,E,G)"),
        (three_states, ""),
        (read_error, "0"),
        (read_error, '0,"No error'),
        (read_error, "(@1),(@2)"),
        (read_connections, f"(@{'9' * 5000}),(@1)"),
    ],
)
def test_anything_else_is_garbled(read: Reader, text: str) -> None:
    with pytest.raises(GarbledReply) as caught:
        read(text)
    assert len(str(caught.value)) < 120


def test_connections_are_written_as_they_are_read() -> None:
    connections = {3: 17, 1: 19}
    assert pairs(connections) == "(@3,1),(@17,19)"
    assert read_connections(pairs(connections)) == connections
    assert channels([]) == "(@)"


def test_only_errors_are_errors() -> None:
    assert is_error('0,"No error"')
    assert not any(map(is_error, ("16,16", "1", "(@),(@)", 'IP="192.0.2.1"')))


def means(read: Reader, text: str) -> Any:
    """Return what a reply can mean at most: all its numbers, words or letters, in their order."""
    if read is three_powers:
        return [float(item) for item in text.strip("()").split(",")]
    if read is three_states:
        return re.findall(r"\w", text)
    if read is read_error:
        number, _, words = text.partition(",")
        return int(number), words.strip().removeprefix('"').removesuffix('"')
    half = len(numbers := [int(number) for number in re.findall(r"\d+", text)]) // 2
    return dict(zip(numbers[:half], numbers[half:], strict=True))


def test_mutated_replies_are_garbled_or_mean_what_they_say() -> None:
    rng, outcomes = random.Random(1), Counter[str]()
    for _ in range(5000):
        read, text, meaning = rng.choice(GOOD)
        mutated = list(text)
        for _change in range(rng.randint(1, 3)):
            position = rng.randrange(len(mutated))
            mutated[position : position + rng.randint(0, 1)] = rng.choice('(@),0179-+."eE _ F;')
        output = "".join(mutated)
        try:
            found = read(output)
        except GarbledReply:
            outcomes["garbled"] += 1
        else:
            assert found == means(read, output), output
            outcomes["alike" if found == meaning else "other"] += 1
    assert min(outcomes.values()) > 100, outcomes
