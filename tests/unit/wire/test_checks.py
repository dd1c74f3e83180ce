"""The checks of every configuration refuse in the same words."""

from collections.abc import Callable
from math import inf, nan
from typing import Any

import pytest

from applications.teleportation.teleport import TeleportOptions
from controller_apps.policy.reading import parse_policy
from hosts.middleware.session.errors import SessionError
from qmn.network.checks import check_two_hosts
from qmn.network.options import NetworkOptions
from qmn.options import BadInput, from_keywords
from topologies.description.checked_graph import checked
from topologies.ring import RingTopo
from wire.malformed import MalformedPacket
from wire.parameters.checks import check_choice, check_names, check_number, nearest, range_words
from wire.parameters.fiber import optics
from wire.parameters.physics import BadParameter, Device
from wire.typed_json import read


@pytest.mark.parametrize(
    ("value", "least", "most", "fits"),
    [
        (0, 0, 3, True),
        (3, 0, 3, True),
        (4, 0, 3, False),
        (1.0, 0, 3, False),  # not a whole number
        (True, 0, 3, False),
        ("1", 0, 3, False),
        (1, 0.0, 1.0, True),
        (1.5, 0.0, 1.0, False),
        (nan, 0.0, inf, False),
        (1e300, 0.0, inf, True),
        (None, 0.0, 1.0, False),
    ],
)
def test_a_number_is_in_its_range_and_whole_if_that_begins_with_a_whole_one(
    value: Any, least: float, most: float, fits: bool
) -> None:
    if fits:
        check_number("it", value, least, most)
    else:
        with pytest.raises(ValueError, match=rf"^it {value!r}: choose "):
            check_number("it", value, least, most)


def test_ranges_are_said_as_people_write_numbers() -> None:
    assert range_words(1, 4_000_000_000) == "1 to 4000000000"
    assert range_words(0.0, 1e-9) == "0 to 1e-09"
    assert range_words(0, inf) == "0 or more"


def test_the_nearest_name_is_offered_and_else_all() -> None:
    check_names("it", ["b", "a"], ["a", "b"])
    with pytest.raises(ValueError, match=r"^it has no lenght: did you mean length\?$"):
        check_names("it", ["lenght", "loss"], ["length", "loss"])
    with pytest.raises(ValueError, match=r"^it has no LOSS: did you mean loss\?$"):
        check_names("it", ["LOSS"], ["length", "loss"])
    with pytest.raises(ValueError, match=r"^it has no x: choose one of length, loss$"):
        check_names("it", {"x": 1}, ["length", "loss"])


def test_a_choice_is_one_of_the_words() -> None:
    check_choice("kind", "any", ("any", "none"))
    for value in ("some", 1, None, ["any"]):
        with pytest.raises(ValueError, match=r"^kind .*: choose one of any, none$"):
            check_choice("kind", value, ("any", "none"))
    with pytest.raises(ValueError, match=r"^kind 'nine': did you mean none\?$"):
        check_choice("kind", "nine", ("any", "none"))
    # Alike as words, but nobody who writes the one means the other.
    with pytest.raises(ValueError, match=r"^host 'alice': choose one of bob, charlie$"):
        check_choice("host", "alice", ("bob", "charlie"))
    with pytest.raises(ValueError, match=r"^host 'alice': there are none$"):
        check_choice("host", "alice", ())


SLIPS: dict[str, tuple[Callable[[], object], type[Exception], str]] = {
    "fibre": (lambda: optics("fibre", lenght_km=1), BadParameter, "did you mean length_km?"),
    "device": (
        lambda: read(Device, {"memry": {}}, "a device"),
        MalformedPacket,
        "did you mean memory?",
    ),
    "topology": (
        lambda: RingTopo(swiches=3),
        BadParameter,
        "RingTopo has no swiches: did you mean",
    ),
    "size of another topology": (
        lambda: RingTopo(hosts=9),
        BadParameter,
        "RingTopo has no hosts: ",
    ),
    "own topology": (lambda: checked(RingTopo)(swiches=3), BadParameter, "did you mean switches?"),
    "host": (
        lambda: check_two_hosts("alise", "b", ["alice", "b"]),
        BadInput,
        "did you mean alice?",
    ),
    "part": (
        lambda: read(Device, {"memory": {"t1": 1}}, "a device"),
        MalformedPacket,
        "a device.memory has no t1: did you mean t1_s?",
    ),
    "network": (
        lambda: from_keywords(NetworkOptions, {"contenton": "queue"}),
        BadInput,
        "did you mean contention?",
    ),
    "session": (
        lambda: TeleportOptions.from_fields({"host": "bob", "port": 9, "cuont": 1}),
        SessionError,
        "did you mean count?",
    ),
    "policy": (lambda: parse_policy("[queue]\nordre = 'slots'"), ValueError, "did you mean order?"),
}


@pytest.mark.parametrize("slip", SLIPS)
def test_a_slip_of_the_pen_is_refused_by_name_with_the_nearest_wherever_it_is(slip: str) -> None:
    make, error, words = SLIPS[slip]
    with pytest.raises(error) as refused:
        make()
    assert words in str(refused.value)


@pytest.mark.parametrize(
    ("name", "known", "meant"),
    [
        ("repeaters", ["requesters"], ""),
        ("message", ["sae"], ""),
        ("charly", ["alice", "charlie"], "charlie"),
        ("teleprot", ["teleport"], "teleport"),
        ("length", ["length_km"], "length_km"),
        ("Bob", ["bob"], "bob"),
        ("sensor", ["sender"], "sender"),  # two letters: no slip of a pen tells them apart
        ("swap", ["seal"], ""),
    ],
)
def test_a_slip_is_told_from_another_word(name: str, known: list[str], meant: str) -> None:
    assert nearest(name, known) == meant
