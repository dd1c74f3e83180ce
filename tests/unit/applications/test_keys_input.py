"""The input of `qmn run keys`, and what it refuses before anything starts."""

import pytest

from applications.keys.config import KEY_LINK_PORTS, KeyLink
from applications.keys.job import checked, service_of
from applications.keys.key_managers import KeyService
from applications.keys.request import KeysRequest
from qmn.__main__ import described
from qmn.jobs.eavesdropping import tapped_path
from qmn.options import BadInput, read


def asked(*words: str) -> KeyService:
    """Return what the command line asks of key managers."""
    whole = ["run", "keys", *words]
    return service_of(*checked(read(KeysRequest, described(whole).parse_args(whole))))


def test_options_reach_the_key_managers() -> None:
    words = "--key-pair alice:bob --key-pair bob:alice --low-mark 3 --high-mark 4 --sae web=bob"
    more = "--session-bits 12000 --key-protocol bbm92 --keys-per-s 2.5 --withhold"
    service = asked(*words.split(), *more.split())
    assert service.pairs == [("alice", "bob"), ("bob", "alice")]
    link = KeyLink("", True, 3, 4, protocol="bbm92", options={"count": 12_000})
    assert service.link == link
    assert (service.saes, service.keys_per_s, service.withhold) == ({"web": "bob"}, 2.5, True)


def test_eve_is_on_the_light_of_who_opens_on_its_way_to_whoever_measures_it() -> None:
    """Of BB84 that is the acceptor, of MDI-QKD the relay; of pairs she is before the acceptor."""
    whole = ["run", "keys", "--eve", "1"]
    _request, network = checked(read(KeysRequest, described(whole).parse_args(whole)))
    paths = {each: tapped_path(each, ("alice", "bob"), "", network) for each in KEY_LINK_PORTS}
    assert paths == {
        "bb84": ("alice", "bob"),
        "bbm92": ("charlie", "bob"),
        "e91": ("charlie", "bob"),
        "mdi": ("alice", "charlie"),
    }


def test_alice_and_bob_keep_keys_if_nobody_is_named() -> None:
    assert asked().pairs == [("alice", "bob")]


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
        (("--certificates", "/nowhere"), "/nowhere is not a folder"),
    ],
)
def test_what_cannot_be_is_refused(words: tuple[str, ...], text: str) -> None:
    with pytest.raises(BadInput, match=text):
        asked(*words)
