"""Proposals of conference keys: golden bytes, and what is none."""

import struct

import pytest

from applications.qkd.conference_proposal import ConferenceProposal
from applications.qkd.messages import Bound
from wire.malformed import MalformedPacket

PROPOSAL = ConferenceProposal(0x0102030405060708, Bound.FINITE, 0.5, 0.25, ("alice", "bob"))
GOLDEN = bytes.fromhex("01 0102030405060708 01 3fe0000000000000 3fd0000000000000") + b"alice,bob"


def test_a_proposal_has_these_bytes() -> None:
    assert PROPOSAL.encode() == GOLDEN
    assert ConferenceProposal.decode(GOLDEN) == PROPOSAL


@pytest.mark.parametrize("length", range(27))
def test_what_is_cut_off_before_the_names_is_none(length: int) -> None:
    with pytest.raises(MalformedPacket):
        ConferenceProposal.decode(GOLDEN[:length])


@pytest.mark.parametrize(
    "data",
    [
        b"\2" + GOLDEN[1:],  # another version
        GOLDEN[:9] + b"\3" + GOLDEN[10:],  # a bound that there is not
        GOLDEN[:10] + struct.pack("!d", 0.0) + GOLDEN[18:],
        GOLDEN[:10] + struct.pack("!d", float("nan")) + GOLDEN[18:],
        GOLDEN[:18] + struct.pack("!d", 1.0) + GOLDEN[26:],
        GOLDEN + b",bob",  # a host twice
        GOLDEN + b",",  # one without a name
        GOLDEN + b"\xff",
        GOLDEN + bytes(2000),
    ],
)
def test_what_cannot_be_is_none(data: bytes) -> None:
    with pytest.raises(MalformedPacket):
        ConferenceProposal.decode(data)
