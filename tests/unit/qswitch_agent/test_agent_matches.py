"""Matches as Open vSwitch understands them: which fields they have, and which covers which."""

from typing import Any

import openflow_messages as of
import pytest
from openflow_messages import FIBERS
from os_ken.ofproto import ofproto_v1_4 as ofp

from qswitch_agent.openflow import matches
from qswitch_agent.openflow.matches import IN_PORT, covers, parse
from qswitch_agent.openflow.messages import MalformedPart

ANYTHING = parse(b"")


def fields(**wanted: Any) -> matches.Fields:
    """Return a match that os_ken has encoded."""
    return of.mod(wanted).fields


def test_match_of_os_ken_is_taken_apart() -> None:
    assert fields(in_port=3) == {IN_PORT: (bytes([0, 0, 0, 3]), b"\xff" * 4)}
    assert matches.in_port(fields(in_port=3)) == 3
    assert matches.in_port(fields(eth_type=0x88CC)) is None
    masked = fields(eth_dst=("01:80:c2:00:00:00", "ff:ff:ff:00:00:00"))
    assert list(masked.values()) == [
        (bytes.fromhex("0180c2000000"), bytes.fromhex("ffffff000000")),
    ]


def test_match_and_what_is_behind_are_split_and_joined() -> None:
    oxm = matches.of_port(1)
    whole = matches.join(oxm)
    assert whole == bytes.fromhex("0001000c 80000004 00000001 00000000")
    assert matches.split(whole + b"more") == (oxm, b"more")
    bad_type, bad_length = ofp.OFPBMC_BAD_TYPE, ofp.OFPBMC_BAD_LEN
    for kind, length, code in ((0, 12, bad_type), (1, 3, bad_length), (1, 21, bad_length)):
        with pytest.raises(MalformedPart) as wrong:
            matches.split(bytes([0, kind, 0, length]) + whole[4:] + b"more")
        assert (wrong.value.kind, wrong.value.code) == (ofp.OFPET_BAD_MATCH, code)


def test_port_is_written_as_the_bridge_writes_it() -> None:
    assert matches.of_port(7) == of.mod({"in_port": 7}).match


def test_older_name_of_the_port_is_the_port() -> None:
    assert parse(bytes.fromhex("00000002 0003")) == fields(in_port=3)


@pytest.mark.parametrize(
    "nothing",
    [
        "80000108 00000003 00000000",  # in_port
        "00000104 0003 0000",  # in_port of Nicira
        "8000070c 020000000000 000000000000",  # eth_dst
        "ffff570c 4f4e4600 00000003 00000000",  # of an experimenter
    ],
)
def test_field_with_a_mask_of_zero_asks_for_nothing(nothing: str) -> None:
    assert parse(bytes.fromhex(nothing)) == ANYTHING
    assert parse(bytes.fromhex(nothing) + matches.of_port(2)) == fields(in_port=2)


def test_port_with_a_part_of_a_mask_is_noticed() -> None:
    half = parse(bytes.fromhex("80000108 00000003 00000001"))
    assert matches.in_port_is_masked(half)
    assert matches.in_port_is_masked(parse(bytes.fromhex("00000104 0003 0001")))
    assert not matches.in_port_is_masked(parse(bytes.fromhex("80000108 00000003 ffffffff")))
    assert not matches.in_port_is_masked(ANYTHING)


@pytest.mark.parametrize(
    ("data", "code"),
    [
        ("80", ofp.OFPBMC_BAD_LEN),
        ("800000", ofp.OFPBMC_BAD_LEN),
        ("80000004 000000", ofp.OFPBMC_BAD_LEN),
        ("80000006 000000000001", ofp.OFPBMC_BAD_LEN),  # in_port of 6 bytes
        ("80000109 00000003 ffffffffff", ofp.OFPBMC_BAD_LEN),  # half a mask
        ("80000004 00000001 80000004 00000002", ofp.OFPBMC_DUP_FIELD),
        ("80000004 00000001 00000002 0001", ofp.OFPBMC_DUP_FIELD),
        ("ffff5603 4f4e46", ofp.OFPBMC_BAD_LEN),  # an experimenter's name cut short
    ],
)
def test_match_that_is_not_whole_is_malformed(data: str, code: int) -> None:
    with pytest.raises(MalformedPart) as wrong:
        parse(bytes.fromhex(data))
    assert (wrong.value.kind, wrong.value.code) == (ofp.OFPET_BAD_MATCH, code)


def test_fields_of_two_experimenters_are_two_fields() -> None:
    assert len(parse(bytes.fromhex("ffff5606 4f4e4600 0001 ffff5606 00002320 0001"))) == 2


def test_only_lldp_is_lldp() -> None:
    assert matches.is_of_type(fields(in_port=1, eth_type=0x88CC), matches.LLDP)
    assert not matches.is_of_type(fields(in_port=1, eth_type=0x0800), matches.LLDP)
    assert not matches.is_of_type(fields(in_port=1), matches.LLDP)
    assert not matches.is_of_type(parse(bytes.fromhex("80000b04 88cc fffe")), matches.LLDP)


def test_wide_match_covers_the_narrow_one() -> None:
    for port in FIBERS:
        assert covers(ANYTHING, fields(in_port=port))
        assert covers(fields(in_port=port), fields(in_port=port, eth_type=0x88CC))
        assert not covers(fields(in_port=port, eth_type=0x88CC), fields(in_port=port))
        assert not covers(fields(in_port=port), fields(in_port=9))
        assert not covers(fields(in_port=port), ANYTHING)


def test_mask_decides_what_is_covered() -> None:
    group = fields(eth_dst=("01:80:c2:00:00:00", "ff:ff:ff:00:00:00"))
    assert covers(group, fields(eth_dst="01:80:c2:00:00:0e"))
    assert not covers(group, fields(eth_dst="01:80:c3:00:00:0e"))
    assert not covers(fields(eth_dst="01:80:c2:00:00:00"), group)
    assert covers(group, fields(eth_dst=("01:80:c2:00:00:00", "ff:ff:ff:ff:00:00")))


def test_long_match_is_read_as_well_as_a_short_one() -> None:
    many = b"".join(bytes([0x80, 1, number << 1, 4, 0, 0, 0, number]) for number in range(100))
    assert len(parse(many)) == 100
    with pytest.raises(MalformedPart, match="twice"):
        parse(many + many[:8])
