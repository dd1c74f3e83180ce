"""OpenFlow 1.4's optical port properties as bytes, and our experimenter message for paths.

The properties are those of the specification (7.2.1.2, 7.3.4.3 and 7.3.5.7), in network byte
order. Units: frequencies in MHz (OFPOPF_USE_FREQ is always set by us), power in dBm * 10 as
a signed number in an unsigned field, bias current in mA * 10, temperature in degrees C * 10.
"""

import struct
from collections.abc import Iterable
from dataclasses import astuple, dataclass
from typing import ClassVar, Self

from wire.malformed import MalformedPacket

PROPERTY = struct.Struct("!HH")  # type, length without the padding
OPTICAL = 1  # OFPPDPT_OPTICAL, OFPPMPT_OPTICAL and OFPPSPT_OPTICAL alike
EXPERIMENTER = 0x00514D4E  # "QMN"; not registered with the ONF
PATH_OPTICS, ANALYSER_COUNTS, MEMORY_COUNTS = 1, 2, 3  # exp_type of our OFPMP_EXPERIMENTER messages
EMISSION = 1  # exp_type of our OFPT_EXPERIMENTER message: port of a source (4), frame into it
ANY_PORT = 0xFFFFFFFF

RX_TUNE, TX_TUNE, TX_PWR, USE_FREQ = 1, 2, 4, 8  # OFPOPF_
# OFPOSF_, the flags of port statistics: which fields are valid.
VALID_RX_TUNE, VALID_TX_TUNE, VALID_TX_PWR = 1, 2, 4
VALID_RX_PWR, VALID_TX_BIAS, VALID_TX_TEMP = 16, 32, 64
ALL_VALID = 0x77
DARK = -0x8000  # in a field of power: no light
TUNABLE = RX_TUNE | TX_TUNE | TX_PWR | USE_FREQ

LIGHT_M_PER_S = 299_792_458
CHANNEL_MHZ = 12_500  # finest grid of ITU-T G.694.1
DEFAULT_FREQUENCY_MHZ = 193_400_000  # 1550.12 nm
WAVELENGTHS_PM = (100_000, 10_000_000)  # ultraviolet to infrared
ANY_WAVELENGTH = 0  # of a set-up: the controller chooses the channel, and writes it there


@dataclass(frozen=True)
class OpticalProperty:
    """Type, length and the fields; padded to a multiple of 8 bytes, as all properties are."""

    FIELDS: ClassVar[struct.Struct]

    def encode(self) -> bytes:
        length = PROPERTY.size + self.FIELDS.size
        body = PROPERTY.pack(OPTICAL, length) + self.FIELDS.pack(*astuple(self))
        return body + b"\0" * (-length % 8)

    @classmethod
    def decode(cls, data: bytes) -> Self:
        """Read a property, with or without padding; raise MalformedPacket for another one."""
        length = PROPERTY.size + cls.FIELDS.size
        if len(data) < length or PROPERTY.unpack_from(data) != (OPTICAL, length):
            raise MalformedPacket(f"{cls.__name__}: not an optical property of {length} bytes")
        return cls(*cls.FIELDS.unpack_from(data, PROPERTY.size))


@dataclass(frozen=True)
class PortOptics(OpticalProperty):
    """ofp_port_desc_prop_optical: how far a port can be tuned."""

    FIELDS = struct.Struct("!4x7Ihh")

    supported: int  # OFPOPF_ bits
    tx_min_mhz: int
    tx_max_mhz: int
    tx_grid_mhz: int
    rx_min_mhz: int
    rx_max_mhz: int
    rx_grid_mhz: int
    tx_power_min: int  # dBm * 10
    tx_power_max: int


@dataclass(frozen=True)
class PortTuning(OpticalProperty):
    """ofp_port_mod_prop_optical: what a controller wants of a port."""

    FIELDS = struct.Struct("!IIiIi")
    LENGTH: ClassVar[int] = PROPERTY.size + FIELDS.size

    configure: int  # OFPOPF_ bits: which of the fields count
    frequency: int  # MHz if USE_FREQ is set, else nm * 100
    offset: int  # of the same unit, added to the frequency
    grid_span: int
    tx_power: int  # dBm * 10


@dataclass(frozen=True)
class PortLight(OpticalProperty):
    """ofp_port_stats_prop_optical: how a port is tuned and what it measures."""

    FIELDS = struct.Struct("!4xIIiIIiIhhHh")

    flags: int  # OFPOSF_ bits: which of the fields are valid
    tx_mhz: int
    tx_offset: int
    tx_grid_span: int
    rx_mhz: int
    rx_offset: int
    rx_grid_span: int
    tx_power: int  # dBm * 10
    rx_power: int
    bias_current: int  # mA * 10
    temperature: int  # degrees C * 10


@dataclass(frozen=True)
class PathOptics:
    """The effects of a path through a switch; ports ANY_PORT stand for all others."""

    FIELDS: ClassVar[struct.Struct] = struct.Struct("!IIIBB2x")

    in_port: int
    out_port: int
    loss_mdb: int  # insertion loss in thousandths of a dB
    rotation: int  # wire.outcomes.Pauli
    stuck: bool = False  # the path cannot be changed

    def encode(self) -> bytes:
        return self.FIELDS.pack(*astuple(self))


def encode_path_optics(paths: Iterable[PathOptics]) -> bytes:
    return b"".join(path.encode() for path in paths)


def decode_path_optics(body: bytes) -> list[PathOptics]:
    """Read the body of a reply; raise MalformedPacket if it is not whole entries."""
    if len(body) % PathOptics.FIELDS.size:
        raise MalformedPacket(f"path optics of {len(body)} bytes")
    paths = []
    for in_port, out_port, loss_mdb, rotation, stuck in PathOptics.FIELDS.iter_unpack(body):
        if rotation > 3 or stuck > 1:
            raise MalformedPacket(f"path optics with rotation {rotation}, stuck {stuck}")
        paths.append(PathOptics(in_port, out_port, loss_mdb, rotation, bool(stuck)))
    return paths


def frequency_mhz(wavelength_pm: int) -> int:
    """Return the channel of ITU-T G.694.1 that a wavelength in picometres is in.

    Raise ValueError for a wavelength outside the optical range.
    """
    least, most = WAVELENGTHS_PM
    if not least <= wavelength_pm <= most:
        raise ValueError(f"wavelength {wavelength_pm} pm is not {least} to {most} pm")
    return round(LIGHT_M_PER_S * 1e6 / wavelength_pm / CHANNEL_MHZ) * CHANNEL_MHZ


def wavelength_pm(frequency_mhz: int) -> int:
    return round(LIGHT_M_PER_S * 1e6 / frequency_mhz)
