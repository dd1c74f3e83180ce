"""The features that a host announces: golden bytes, and everything else refused."""

import re

import pytest

from wire.features import (
    EMIT,
    EVERYTHING,
    GATE,
    HERALD,
    MEASURE,
    NOTHING,
    STORE,
    NodeFeatures,
    names,
)
from wire.light import Role
from wire.malformed import MalformedPacket
from wire.metadata.vocabulary import Service
from wire.services import (
    HERALDED,
    LIGHT,
    NEEDS,
    OWN_LIGHT,
    Making,
    beams,
    fibers_needed,
    needs,
    uses_source,
)

GOLDEN = [
    (NodeFeatures(EVERYTHING, 4_000_000), "7f003d0900"),
    (NodeFeatures(EMIT | STORE | MEASURE, 32), "0b00000020"),
    (NodeFeatures(NOTHING, 0), "0000000000"),
]
REFUSED = [
    ("", "features in 0 bytes, not 5"),
    ("0f003d09", "features in 4 bytes"),
    ("0f003d090000", "features in 6 bytes"),
    ("80000000ff", "features 0x80, of which 0x7f exist"),
    ("ff000000ff", "features 0xff"),
    ("0200000000", "store with a memory of 0 qubits"),
    ("0d00000001", "emit, gate, measure with a memory of 1 qubits"),
]


@pytest.mark.parametrize(("node_features", "data"), GOLDEN)
def test_abilities_are_these_bytes_both_ways(node_features: NodeFeatures, data: str) -> None:
    assert node_features.encode().hex() == data
    assert NodeFeatures.decode(bytes.fromhex(data)) == node_features


@pytest.mark.parametrize(("data", "message"), REFUSED)
def test_what_no_host_can_be_is_refused(data: str, message: str) -> None:
    with pytest.raises(MalformedPacket, match=re.escape(message)):
        NodeFeatures.decode(bytes.fromhex(data))


def test_of_two_announcements_only_what_both_say_is_true() -> None:
    one, other = NodeFeatures(EMIT | STORE, 32), NodeFeatures(STORE | GATE, 10)
    assert one.both(other) == other.both(one) == NodeFeatures(STORE, 10)


def test_features_have_names() -> None:
    assert names(EMIT | MEASURE) == "emit, measure"
    assert names(NOTHING) == "nothing"


def test_every_service_says_what_its_hosts_must_be_able_to() -> None:
    assert NEEDS.keys() == LIGHT.keys()
    for service in LIGHT:
        senders = {start.role for start, _end in beams(service)}
        assert all(EMIT in needs(service, role) for role in senders if role != Role.OPENER)
    assert needs(Service.PAIR_SOURCE, Role.SOURCE) == NOTHING


def test_a_source_of_its_own_needs_one_fibre_and_no_third_host() -> None:
    for service in OWN_LIGHT:
        ends = [end.role for beam in beams(service, Making.OPENER) for end in beam]
        assert ends == [Role.OPENER, Role.ACCEPTOR]
        assert fibers_needed(service, Role.SOURCE, Making.OPENER) == 0
        assert fibers_needed(service, Role.SOURCE) == 2
    assert beams(Service.SDC, Making.OPENER) == LIGHT[Service.SDC]


def test_heralded_light_goes_to_switches_and_no_third_host() -> None:
    for service in HERALDED:
        assert beams(service, Making.STATION) == ()
        assert not uses_source(service, Making.STATION)
        for end in (Role.OPENER, Role.ACCEPTOR):
            assert needs(service, end, Making.STATION) == HERALD | STORE
