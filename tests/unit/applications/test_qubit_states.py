"""States of single qubits: their names, their angles, and what of them travels."""

from math import pi

import numpy as np
import pytest

from applications.teleportation import qubit_states
from applications.teleportation.qubit_states import (
    PART,
    TURN,
    Arbitrary,
    Heard,
    States,
    chosen,
)
from hosts.middleware.session.errors import SessionError
from hosts.middleware.session.values import values
from wire.metadata.values import Topic, Values
from wire.metadata.vocabulary import Reason

SESSION = 5
BLOCK = 3


def draws() -> np.random.Generator:
    return np.random.default_rng(4)


@pytest.mark.parametrize(
    ("text", "theta", "phi"),
    [
        ("0,0", 0, 0),
        ("1.25,-0.5", 1.25, -0.5),
        (" pi/3 , -pi/4 ", pi / 3, -pi / 4),
        ("2pi/3,+pi", 2 * pi / 3, pi),
        ("2*pi/3,1e-3", 2 * pi / 3, 1e-3),
        ("pi,-2*pi", pi, -2 * pi),
    ],
)
def test_angles_are_numbers_or_parts_of_pi(text: str, theta: float, phi: float) -> None:
    assert qubit_states.angles(text) == pytest.approx((theta, phi))
    directions = chosen(text, draws(), 3)
    assert isinstance(directions, Arbitrary)
    assert directions.directions.theta_rad == pytest.approx([theta] * 3)
    turned = np.exp(1j * directions.directions.phi_rad)
    assert turned == pytest.approx([np.exp(1j * phi)] * 3, abs=1e-8)


@pytest.mark.parametrize(
    "state",
    [
        "",
        "|0>",
        "pi",
        "1,2,3",
        "1;2",
        "nan,0",
        "0,inf",
        "pi/0,0",
        "pie,0",
        "1..2pi,0",
        ",0",
        "--pi,0",
    ],
)
def test_other_words_are_refused_with_what_there_is(state: str) -> None:
    with pytest.raises(SessionError, match=r"choose one of random, 0, .* haar, or angles THETA"):
        qubit_states.check(state)


@pytest.mark.parametrize(
    ("state", "text"),
    [
        ("-0.1,0", "theta is -0.1, choose 0 to 3.14159 rad"),
        ("45,90", "theta is 45, choose 0 to 3.14159 rad"),
        ("1,90", "phi is 90, choose -6.28319 to 6.28319 rad"),
    ],
)
def test_angles_out_of_range_are_refused_by_name(state: str, text: str) -> None:
    with pytest.raises(SessionError, match=text):
        qubit_states.check(state)


def test_haar_states_are_spread_evenly_over_the_sphere() -> None:
    count = 100_000
    states = chosen("haar", draws(), count)
    assert isinstance(states, Arbitrary)
    theta, phi = states.directions.theta_rad, states.directions.phi_rad
    sphere = np.cos(theta), np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi)
    for one in sphere:
        assert abs(one.mean()) < 5 * (1 / 3 / count) ** 0.5
        # The variance of the square of a component is 1/5 - 1/9.
        assert abs((one**2).mean() - 1 / 3) < 5 * (4 / 45 / count) ** 0.5
        for other in sphere:
            if other is not one:
                assert abs((one * other).mean()) < 5 * (1 / 15 / count) ** 0.5


def peer_states(*messages: Values, size: int) -> States | None:
    """Return what the other end hears of this, after its last message."""
    heard, states = Heard(BLOCK, size), None
    for message in messages:
        assert states is None
        states = heard.hear(message)
    return states


@pytest.mark.parametrize("size", [1, 20_000, 262_144])
@pytest.mark.parametrize("name", ["random", "haar"])
def test_what_is_told_is_what_was_prepared(name: str, size: int) -> None:
    states = chosen(name, draws(), size)
    messages = states.messages(SESSION, BLOCK)
    assert all(message.count <= PART for message in messages)
    found = peer_states(*messages, size=size)
    assert type(found) is type(states)
    for field, array in vars(states).items():
        np.testing.assert_array_equal(getattr(found, field), array)


def say(topic: int, numbers: list[int], width: int, block: int = BLOCK) -> Values:
    return values(SESSION, topic, block, numbers, width)


@pytest.mark.parametrize(
    ("message", "text"),
    [
        (say(Topic.STATES, [0, 6], 8), "a value of topic 2 is 6, at most 5 is known"),
        (say(Topic.STATES, [0], 8), "1 values of topic 2, 2 were expected"),
        (say(Topic.STATES, [0, 0], 8, block=9), "block 9 came where 2 .STATES. and 3 were due"),
        (say(Topic.COUNTS, [0, 0], 8), "topic 8 .COUNTS. and block 3 came where 2"),
        (say(Topic.DIRECTIONS, [0, 0], 32), "2 values of topic 12, 4 were expected"),
        (say(Topic.DIRECTIONS, [0] * 5, 32), "5 values of topic 12, 4 were expected"),
        (say(Topic.DIRECTIONS, [0, TURN // 2 + 1, 0, 0], 32), "theta is 2147483649"),
    ],
)
def test_what_is_no_state_of_the_block_is_refused(message: Values, text: str) -> None:
    with pytest.raises(SessionError, match=text) as caught:
        peer_states(message, size=2)
    assert caught.value.reason == Reason.PROTOCOL
