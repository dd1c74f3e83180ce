"""Conference keys between whole stacks over loopback, and what both ends make of outcomes."""

import asyncio
import re
from dataclasses import replace
from math import log2, sqrt
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from limits import SOON_S
from line_scene import LINE as ALL
from line_scene import summaries
from stacks_scene import Change, network, requested

from applications.qkd import conference
from applications.qkd.bits import Bits
from hosts import network_loop
from hosts.middleware.session.values import numbers_of
from hosts.service_socket import ServiceSocket
from hosts.stack_socket import QuantumSocketError
from wire.metadata.header import Message
from wire.metadata.values import Topic, Values

LINE = ALL[:3]
COUNT = 30_000


def agreed(folder: Path, **words: Any) -> list[dict[str, Any]]:
    """Return the results of all hosts, in their order."""
    physics = words.pop("physics", {})
    return summaries(folder, "conference", LINE, {"count": COUNT, **words}, **physics)


def keys_of(folder: Path, host: str) -> dict[str, bytes]:
    """Return the keys in the store that a host has of all three."""
    stored = (folder / "keys" / host / "+".join(LINE)).glob("*/*-*")
    return {file.name: file.read_bytes() for file in stored}


def entropy(p: float) -> float:
    return -p * log2(p) - (1 - p) * log2(1 - p)


def test_all_hosts_have_the_same_keys(tmp_path: Path) -> None:
    alice, bob, charlie = agreed(tmp_path)
    assert bob["key_bits"] == charlie["key_bits"] == alice["key_bits"]
    assert (alice["qber_x"], alice["qber_z"]) == (0, [0, 0])
    assert alice["states"] >= COUNT
    assert 0 < alice["key_bits"] < alice["raw_bits"]
    keys = [keys_of(tmp_path, host) for host in LINE]
    assert len(keys[0]) == alice["keys"] == alice["key_bits"] // 256 > 0
    assert keys[0] == keys[1] == keys[2]
    assert len(set(keys[0].values())) == len(keys[0])


def test_error_rates_are_those_of_the_links_and_the_key_is_as_long_as_they_leave(
    tmp_path: Path,
) -> None:
    """Each link flips a bit, and a phase, with P/2, of P = 1 - (1 - p)^2 over its two fibres."""
    alice, bob, charlie = agreed(tmp_path, bound="asymptotic", physics={"depolarizing": 0.01})
    link = 1 - 0.99**2
    near, far = link / 2, (1 - (1 - link) ** 2) / 2
    for found, expected, tests in (
        (alice["qber_x"], far, alice["tests_in_x"]),
        (alice["qber_z"][0], near, alice["tests_in_z"]),
        (alice["qber_z"][1], far, alice["tests_in_z"]),
    ):
        assert abs(found - expected) < 5 * sqrt(expected * (1 - expected) / tests)
        assert abs(tests - 0.1 * alice["states"]) < 5 * sqrt(0.09 * alice["states"])
    # n (1 - h(Q_X)) less the parities and the hash of 128 bits that are sent.
    secret = alice["raw_bits"] * (1 - entropy(alice["qber_x"]))
    assert alice["key_bits"] == int(secret - alice["leaked_bits"] - 128)
    worst = max(alice["qber_z"])
    assert alice["leaked_bits"] > alice["raw_bits"] * entropy(worst)  # Shannon's bound
    limit = 1 - entropy(alice["qber_x"]) - entropy(worst)
    assert alice["key_fraction"] < alice["key_fraction_limit"] == pytest.approx(limit)
    assert "nothing is proven" in alice["assumed"]
    assert alice["key_bits"] == bob["key_bits"] == charlie["key_bits"]
    assert keys_of(tmp_path, "alice") == keys_of(tmp_path, "charlie") != {}


def refused(folder: Path, **words: Any) -> str:
    """Return why there is no key, and see that nobody has one."""
    with pytest.raises(QuantumSocketError) as caught:
        agreed(folder, **words)
    assert all(keys_of(folder, host) == {} for host in LINE)
    return str(caught.value)


def test_too_much_noise_leaves_no_key_anywhere(tmp_path: Path) -> None:
    """(1 - .9^4)/2 = .17 of the parities are odd, and of charlie's bits differ."""
    text = refused(tmp_path, count=2000, physics={"depolarizing": 0.1})
    assert "noise or an eavesdropper" in text


def test_too_few_states_leave_no_key(tmp_path: Path) -> None:
    text = refused(tmp_path, count=300)
    assert "no secret bit in" in text
    assert "--count more" in text


def test_bits_that_differ_after_correction_are_no_key(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Belief propagation can end with a wrong word of the code, as it does here at one host."""
    last_bits = [0, 1]

    def wrong(key: Bits, *_words: object) -> Bits:
        return np.concatenate([key[:-1], key[-1:] ^ last_bits.pop()])

    monkeypatch.setattr(conference, "corrected", wrong)
    text = refused(tmp_path)
    assert re.search("the corrected bits of (bob|charlie) differ: nothing is delivered", text)


def test_an_option_out_of_range_is_refused(tmp_path: Path) -> None:
    with pytest.raises(QuantumSocketError, match=r"epsilon 2\.0: choose a fraction"):
        agreed(tmp_path, epsilon=2.0)


def flipped(message: Values, place: int) -> Values:
    """Return values of which the last bit of one is another."""
    bit = (place + 1) * message.width - 1
    data = bytearray(message.data)
    data[bit // 8] ^= 0x80 >> bit % 8
    return replace(message, data=bytes(data))


def altered(topic: Topic, way: str) -> Change:
    """Return somebody on the way who changes the first message of a topic, and no other.

    Of outcomes it is one that is 1, which only that of a test can be.
    """
    left = [1]

    def change(direction: str, message: Message) -> Message:
        is_it = isinstance(message, Values) and (message.topic, direction) == (topic, way)
        if not (is_it and left):
            return message
        assert isinstance(message, Values)
        if topic != Topic.OUTCOMES:
            left.pop()
            return flipped(message, 0)
        ones = np.flatnonzero(numbers_of(message) == 1)
        if not ones.size:
            return message
        left.pop()
        return flipped(message, int(ones[0]))

    return change


@pytest.mark.by_day(every=2)
@pytest.mark.parametrize(
    ("topic", "way"),
    [
        (Topic.OUTCOMES, "back"),
        (Topic.RECEIPT, "back"),
        (Topic.AMPLIFY, "forth"),
        (Topic.SYNDROME, "forth"),
        (Topic.TAGS, "forth"),
        (Topic.TAGS, "back"),
    ],
)
def test_who_changes_what_is_said_on_the_way_is_found(
    tmp_path: Path, topic: Topic, way: str
) -> None:
    """An outcome, a seed, a proof: no tag fits then, and nobody keeps a key."""
    text = refused(tmp_path, physics={"change": altered(topic, way)})
    assert "a message was changed on its way" in text


def test_what_states_are_for_is_not_said_before_all_have_proved_that_they_hold_them(
    tmp_path: Path,
) -> None:
    """An eavesdropper could measure charlie's photons of the key in Z, and pass on the others."""
    texts = set[int]()
    without_receipt = altered(Topic.RECEIPT, "back")

    def change(direction: str, message: Message) -> Message:
        if isinstance(message, Values):
            texts.add(message.topic)
        changed = without_receipt(direction, message)
        assert isinstance(changed, Message)
        return changed

    refused(tmp_path, physics={"change": change})
    assert Topic.RECEIPT in texts
    assert Topic.BASES not in texts


def test_who_measures_and_resends_is_found(tmp_path: Path) -> None:
    """Eve is in the link of alice and bob: of the parities in X half are odd where she took Z."""

    def asked() -> str:
        with ServiceSocket(tmp_path / "eve.sock") as eve:
            eve.settimeout(SOON_S)
            eve.intercept(1.0)
            with pytest.raises(QuantumSocketError) as caught:
                requested(tmp_path, "conference", count=2000, line="alice,bob")
            return str(caught.value)

    async def run() -> str:
        async with network(tmp_path, paths=[(1, 6), (7, 2)]):
            return await asyncio.to_thread(asked)

    assert "tests of the parity in X" in network_loop.run(run())
