"""What `qmn run keys` can be told, and what it refuses before anything starts."""

import argparse

import pytest

from qmn.jobs.keys import add_parser, check_input
from qmn.network.options import BadInput
from wire.key_manager import KeyLink


def parse(*words: str) -> argparse.Namespace:
    parser = argparse.ArgumentParser()
    add_parser(parser.add_subparsers())
    return parser.parse_args(["keys", *words])


def test_options_reach_the_key_managers() -> None:
    words = "--key-pair alice:bob --key-pair bob:charlie --low-mark 3 --high-mark 4 --sae web=bob"
    more = "--session-bits 12000 --key-protocol bbm92 --keys-per-s 2.5 --withhold"
    service = check_input(parse(*words.split(), *more.split()))
    assert service.pairs == [("alice", "bob"), ("bob", "charlie")]
    link = KeyLink("", True, 3, 4, protocol="bbm92", options={"count": 12_000})
    assert service.link == link
    assert (service.saes, service.keys_per_s, service.withhold) == ({"web": "bob"}, 2.5, True)


def test_alice_and_bob_keep_keys_if_nobody_is_named() -> None:
    assert check_input(parse()).pairs == [("alice", "bob")]


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (("--key-pair", "alice"), "write A:B, two of alice, bob, charlie"),
        (("--key-pair", "alice:zoe"), "write A:B"),
        (("--key-pair", "bob:bob"), "write A:B"),
        (("--sae", "web=zoe"), "write ID=HOST"),
        (("--low-mark", "9", "--high-mark", "8"), "--high-mark 8: choose 9 to"),
        (("--keys-per-s", "-1"), "--keys-per-s -1.0: choose 0 to"),
        (("--eve", "2"), "--eve 2.0: choose 0 to 1"),
        (("--eve", "1", "--at", "5", "--until", "5"), "--until 5 is not after --at 5"),
        (("--certificates", "/nowhere"), "/nowhere is no folder"),
    ],
)
def test_what_cannot_be_is_refused(words: tuple[str, ...], text: str) -> None:
    with pytest.raises(BadInput, match=text):
        check_input(parse(*words))
