"""A folder as bytes, on its way to another machine: its folders and files, one behind the other.

!BHQI  kind, length of the name, when it was changed (ns since 1970), length of what is in it
       name: relative, in UTF-8, its parts apart by "/"
       what is in it

A folder stands before what is in it. Links, devices, owners and modes have no field, as they have
in tar: what refuses those of others (tarfile.data_filter) not every Python 3.11 has.
"""

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum

from wire.malformed import MalformedPacket

HEADER = struct.Struct("!BHQI")
MOST_BYTES = 1 << 27  # of it all
MOST_ENTRIES = 1 << 19
MOST_PARTS = 32  # of a name
MOST_PART_BYTES = 255  # NAME_MAX of limits.h


class Kind(IntEnum):
    FOLDER = 0
    FILE = 1
    PROGRAM = 2  # a file that its owner can execute


@dataclass(frozen=True)
class Entry:
    """A folder or file inside."""

    name: str
    kind: Kind
    changed_ns: int = 0
    data: bytes = b""


def encode(entries: Sequence[Entry]) -> bytes:
    """Return them as bytes; raise ValueError for what nobody would take."""
    parts, kinds = [], dict[str, Kind]()
    for entry in entries:
        name = _checked(entry, kinds).encode()
        length = len(entry.data)
        parts += [HEADER.pack(entry.kind, len(name), entry.changed_ns, length), name, entry.data]
    _check_size(sum(map(len, parts)), len(entries))
    return b"".join(parts)


def decode(data: bytes) -> list[Entry]:
    """Return what is in a folder; raise MalformedPacket unless all of it can be."""
    _check_size(len(data), 0)
    entries, kinds, place = list[Entry](), dict[str, Kind](), 0
    while place < len(data):
        if len(data) - place < HEADER.size:
            raise MalformedPacket("a packed folder that is cut off")
        number, name_length, changed_ns, length = HEADER.unpack_from(data, place)
        name_at = place + HEADER.size
        data_at = name_at + name_length
        place = data_at + length
        if place > len(data):
            raise MalformedPacket("a packed folder that is cut off")
        try:
            kind, name = Kind(number), data[name_at:data_at].decode()
        except ValueError as error:
            raise MalformedPacket(f"an entry of a packed folder: {error}") from error
        entry = Entry(name, kind, changed_ns, data[data_at:place])
        _checked(entry, kinds)
        entries.append(entry)
        _check_size(0, len(entries))
    return entries


def _check_size(size: int, entries: int) -> None:
    if size > MOST_BYTES or entries > MOST_ENTRIES:
        most = f"{MOST_BYTES >> 20} MiB in {MOST_ENTRIES:,} files and folders"
        raise MalformedPacket(f"a packed folder with more than {most}")


def _checked(entry: Entry, kinds: dict[str, Kind]) -> str:
    """Return the name of an entry that may stand behind those, and add it; or MalformedPacket."""
    parts = entry.name.split("/")
    if len(parts) > MOST_PARTS or any(not _can_be(part) for part in parts):
        raise MalformedPacket(f"{entry.name[:80]!r} is not a name inside a folder")
    if entry.name in kinds:
        raise MalformedPacket(f"{entry.name!r} is twice in a packed folder")
    above = entry.name.rpartition("/")[0]
    if above and kinds.get(above) is not Kind.FOLDER:
        raise MalformedPacket(f"{entry.name!r} is in no folder that stands before it")
    if entry.kind is Kind.FOLDER and entry.data:
        raise MalformedPacket(f"the folder {entry.name!r} has {len(entry.data)} bytes of a file")
    kinds[entry.name] = entry.kind
    return entry.name


def _can_be(part: str) -> bool:
    """Return whether this is the name of a file, and of none elsewhere."""
    try:
        length = len(part.encode())
    except UnicodeEncodeError:  # of a file whose name is not in UTF-8
        return False
    return 0 < length <= MOST_PART_BYTES and part not in (".", "..") and "\0" not in part
