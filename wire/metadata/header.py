"""The header of quantum metadata, and what its messages have in common.

    0       2    3    4        8                16
    +-------+----+----+--------+----------------+----------------
    | magic |ver |kind| length | session        | fields of the kind
    +-------+----+----+--------+----------------+----------------

Network byte order. `length` counts the whole message. Field vocabulary: paper, sections "Switches"
and "Links".
"""

import struct
from dataclasses import dataclass
from enum import IntEnum
from ipaddress import IPv4Address
from typing import ClassVar, TypeVar

from wire.malformed import MalformedPacket

METADATA_PORT = 9010
QUANTUM_SWITCHES = "03:51:4d:00:00:01"  # of copies for them: of a group, locally administered
TO_SWITCHES = bytes.fromhex(QUANTUM_SWITCHES.replace(":", ""))
MAGIC = 0x514D  # "QM"
VERSION = 5
MAX_LENGTH = 1 << 17
HEADER = struct.Struct("!HBBIQ")

E = TypeVar("E", bound=IntEnum)


@dataclass(frozen=True)
class Elements:
    """The entries of a message behind its fixed fields, until its end."""

    name: str
    form: struct.Struct
    names: tuple[str, ...]  # of its fields
    least: int  # how many there are
    most: int


@dataclass(frozen=True)
class Message:
    """Header and fixed fields; a kind with a variable part overrides encode and parse."""

    KIND: ClassVar[int]
    FIELDS: ClassVar[struct.Struct]
    ELEMENTS: ClassVar[Elements | None] = None

    session: int

    def encode(self) -> bytes:
        _session, *fields = vars(self).values()
        return self._frame(self.FIELDS.pack(*fields))

    def _frame(self, body: bytes) -> bytes:
        length = HEADER.size + len(body)
        return HEADER.pack(MAGIC, VERSION, self.KIND, length, self.session) + body

    @classmethod
    def parse(cls, session: int, body: bytes) -> "Message":
        """Build the message from its body; raise MalformedPacket if it does not fit."""
        if len(body) != cls.FIELDS.size:
            raise MalformedPacket(f"{cls.__name__}: {len(body)} bytes, not {cls.FIELDS.size}")
        return cls(session, *cls.FIELDS.unpack(body))


def parted(kind: type[Message], body: bytes) -> tuple[tuple[int, ...], bytes]:
    if len(body) < kind.FIELDS.size:
        raise MalformedPacket(f"{kind.__name__}: {len(body)} bytes are too few")
    return kind.FIELDS.unpack_from(body), body[kind.FIELDS.size :]


def member(kind: type[E], value: int) -> E:
    """Return what a number means; raise MalformedPacket for one that means nothing."""
    try:
        return kind(value)
    except ValueError as error:
        raise MalformedPacket(f"unknown {kind.__name__.lower()} {value}") from error


def padded_name(padded: bytes) -> str:
    """Return the name in a field; raise MalformedPacket for anything else."""
    try:
        name = padded.rstrip(b"\0").decode("ascii")
    except UnicodeDecodeError as error:
        raise MalformedPacket(f"name {padded!r} is not ASCII") from error
    if not name or not name.isprintable():
        raise MalformedPacket(f"name {padded!r} is not a name")
    return name


def session_of(message: bytes) -> int:
    return int(HEADER.unpack_from(message)[-1])


NUMBERS_APART = 128  # of a host's sessions: those between are of links and lines that belong to one
_PLACE = struct.Struct("!4sI")


def session_number(opener: str, count: int) -> int:
    """Return the number of the count-th session that a host opens, by its IPv4 address.

    It is nobody else's: the controller refuses a host the numbers of others (`is_number_of`).
    """
    place = _PLACE.pack(IPv4Address(opener).packed, count * NUMBERS_APART % (1 << 32))
    return int.from_bytes(place, "big")


def is_number_of(session: int, opener: str) -> bool:
    """Tell whether a host opens sessions of this number, by its IPv4 address."""
    return session >> 32 == int(IPv4Address(opener))
