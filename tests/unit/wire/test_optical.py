"""Optical structures as golden bytes, both ways; os_ken as independent decoder and encoder."""

import struct
from dataclasses import astuple, replace
from typing import Any

import pytest
from os_ken.ofproto import ofproto_v1_4 as ofp
from os_ken.ofproto import ofproto_v1_4_parser as parser

from wire import optical
from wire.malformed import MalformedPacket
from wire.optical import (
    OpticalProperty,
    PathOptics,
    PortLight,
    PortOptics,
    PortTuning,
    decode_path_optics,
    encode_path_optics,
    frequency_mhz,
)

OPTICS = PortOptics(
    0xF, 191_350_000, 196_100_000, 50_000, 191_350_001, 196_100_001, 12_500, -200, 30
)
OPTICS_BYTES = bytes.fromhex(
    "0001" + "0028" + "00000000"  # type, length, padding
    "0000000f"  # supported
    "0b67c4f0" + "0bb03fa0" + "0000c350"  # transmit: from, to, grid
    "0b67c4f1" + "0bb03fa1" + "000030d4"  # receive
    "ff38" + "001e"  # power: from, to
)
TUNING = PortTuning(0xE, 193_400_000, -25_000, 50_000, -55)
TUNING_BYTES = bytes.fromhex(
    "0001" + "0018"  # type, length
    "0000000e" + "0b870cc0"  # configure, frequency
    "ffff9e58" + "0000c350" + "ffffffc9"  # offset, grid, power
)
LIGHT = PortLight(
    0xF, 193_400_000, -25_000, 50_000, 193_450_000, 12_500, 100_000, -10, -305, 600, 451
)
LIGHT_BYTES = bytes.fromhex(
    "0001" + "002c" + "00000000"  # type, length, padding
    "0000000f"  # flags
    "0b870cc0" + "ffff9e58" + "0000c350"  # transmit: frequency, offset, grid
    "0b87d010" + "000030d4" + "000186a0"  # receive
    "fff6" + "fecf" + "0258" + "01c3"  # transmit power, receive power, bias current, temperature
    "00000000"  # to a multiple of 8
)
GOLDEN = [(OPTICS, OPTICS_BYTES), (TUNING, TUNING_BYTES), (LIGHT, LIGHT_BYTES)]
ALL = [pytest.param(*case, id=type(case[0]).__name__) for case in GOLDEN]
PATHS = [PathOptics(optical.ANY_PORT, optical.ANY_PORT, 500, 1), PathOptics(1, 2, 700, 3, True)]
PATHS_BYTES = bytes.fromhex(
    "ffffffff" + "ffffffff" + "000001f4" + "01" + "00" + "0000"
    "00000001" + "00000002" + "000002bc" + "03" + "01" + "0000"
)


def unsigned(width: int, value: int) -> int:
    return value % (1 << width)


@pytest.mark.parametrize(("structure", "golden"), ALL)
def test_structure_is_encoded(structure: OpticalProperty, golden: bytes) -> None:
    assert structure.encode() == golden


@pytest.mark.parametrize(("structure", "golden"), ALL)
def test_structure_is_decoded_with_and_without_padding(
    structure: OpticalProperty, golden: bytes
) -> None:
    length = int.from_bytes(golden[2:4], "big")
    assert type(structure).decode(golden) == structure
    assert type(structure).decode(golden[:length]) == structure


@pytest.mark.parametrize(("structure", "golden"), ALL)
def test_every_truncation_is_malformed(structure: OpticalProperty, golden: bytes) -> None:
    for size in range(int.from_bytes(golden[2:4], "big")):
        with pytest.raises(MalformedPacket, match=type(structure).__name__):
            type(structure).decode(golden[:size])


@pytest.mark.parametrize(("structure", "golden"), ALL)
@pytest.mark.parametrize("step", [-8, -1, 1, 4, 8])
def test_wrong_length_is_malformed(structure: OpticalProperty, golden: bytes, step: int) -> None:
    length = int.from_bytes(golden[2:4], "big") + step
    with pytest.raises(MalformedPacket):
        type(structure).decode(golden[:2] + struct.pack("!H", length) + golden[4:])


@pytest.mark.parametrize(("structure", "golden"), ALL)
def test_another_property_is_malformed(structure: OpticalProperty, golden: bytes) -> None:
    for kind in (0, 2, 0xFFFF):
        with pytest.raises(MalformedPacket):
            type(structure).decode(struct.pack("!H", kind) + golden[2:])


def test_one_structure_is_not_another() -> None:
    for structure, _golden in GOLDEN:
        for other, golden in GOLDEN:
            if other is not structure:
                with pytest.raises(MalformedPacket):
                    type(structure).decode(golden)


def test_os_ken_reads_the_description_of_a_port() -> None:
    read = parser.OFPPortDescPropOptical.parser(OPTICS_BYTES)
    assert (read.type, read.length) == (ofp.OFPPDPT_OPTICAL, 40)
    ours = [unsigned(16 if number > 6 else 32, one) for number, one in enumerate(astuple(OPTICS))]
    names: tuple[str, ...] = (
        "supported",
        "tx_min_freq_lmda",
        "tx_max_freq_lmda",
        "tx_grid_freq_lmda",
    )
    names += ("rx_min_freq_lmda", "rx_max_freq_lmda", "rx_grid_freq_lmda")
    names += ("tx_pwr_min", "tx_pwr_max")
    assert [getattr(read, name) for name in names] == ours


def test_os_ken_reads_the_statistics_of_a_port() -> None:
    read = parser.OFPPortStatsPropOptical.parser(LIGHT_BYTES)
    assert (read.type, read.length) == (ofp.OFPPSPT_OPTICAL, 44)
    names: tuple[str, ...] = (
        "flags",
        "tx_freq_lmda",
        "tx_offset",
        "tx_grid_span",
        "rx_freq_lmda",
        "rx_offset",
    )
    names += ("rx_grid_span", "tx_pwr", "rx_pwr", "bias_current", "temperature")
    widths = [32] * 7 + [16] * 4
    ours = [unsigned(width, one) for width, one in zip(widths, astuple(LIGHT), strict=True)]
    theirs = zip(widths, [getattr(read, name) for name in names], strict=True)
    assert [unsigned(width, one) for width, one in theirs] == ours


def tuning_of_os_ken(tuning: PortTuning) -> bytes:
    wanted: Any = parser.OFPPortModPropOptical(
        type_=ofp.OFPPMPT_OPTICAL,
        configure=tuning.configure,
        freq_lmda=tuning.frequency,
        fl_offset=unsigned(32, tuning.offset),
        grid_span=tuning.grid_span,
        tx_pwr=unsigned(32, tuning.tx_power),
    )
    return bytes(wanted.serialize())


@pytest.mark.parametrize(
    "tuning",
    [
        TUNING,
        PortTuning(0, 0, 0, 0, 0),
        replace(TUNING, offset=2**31 - 1, tx_power=-(2**31)),
        PortTuning(2**32 - 1, 2**32 - 1, -1, 2**32 - 1, -1),
    ],
)
def test_tuning_is_what_os_ken_encodes(tuning: PortTuning) -> None:
    assert PortTuning.decode(tuning_of_os_ken(tuning)) == tuning
    assert tuning.encode() == tuning_of_os_ken(tuning)


def test_paths_are_encoded() -> None:
    assert encode_path_optics(PATHS) == PATHS_BYTES


def test_paths_are_decoded() -> None:
    assert decode_path_optics(PATHS_BYTES) == PATHS
    assert decode_path_optics(b"") == []


@pytest.mark.parametrize("field", ["0400", "ff00", "0002", "00ff"])
def test_path_with_no_such_rotation_or_state_is_malformed(field: str) -> None:
    with pytest.raises(MalformedPacket, match="rotation"):
        decode_path_optics(PATHS_BYTES[:12] + bytes.fromhex(field) + PATHS_BYTES[14:])


@pytest.mark.parametrize(
    ("wavelength_pm", "channel_mhz"),
    [
        (1_550_120, 193_400_000),  # 299792458 m/s / 1550.12 nm = 193.3996 THz
        (1_552_524, 193_100_000),  # the anchor of ITU-T G.694.1
        (1_310_000, 228_850_000),  # 228.8492 THz
    ],
)
def test_wavelength_is_in_a_channel_of_the_grid(wavelength_pm: int, channel_mhz: int) -> None:
    assert frequency_mhz(wavelength_pm) == channel_mhz
    assert channel_mhz % optical.CHANNEL_MHZ == 0


def test_no_wavelength_has_no_channel() -> None:
    for wavelength_pm in (0, -1, 99_999, 10_000_001):
        with pytest.raises(ValueError, match="is not 100000 to 10000000 pm"):
            frequency_mhz(wavelength_pm)
