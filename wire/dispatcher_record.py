"""The file in which a dispatcher records what it was asked: writing, and strict reading."""

import struct
from collections.abc import Iterator
from os import SEEK_END
from pathlib import Path
from typing import BinaryIO

from google.protobuf.message import DecodeError

from wire.dispatcher_service import MAX_MESSAGE_BYTES
from wire.record_pb2 import Ended, Entry

MAGIC = b"qmn dispatcher record 1\n"
LENGTH = struct.Struct("!I")
MAX_ENTRY_BYTES = MAX_MESSAGE_BYTES + 4096


class BadRecord(ValueError):
    """A file that is not a record, or not whole; the message says where and why."""


def begin(file: BinaryIO) -> None:
    file.write(MAGIC)


def write(file: BinaryIO, entry: Entry) -> int:
    """Append an entry; return its length in the file."""
    data = _framed(entry)
    file.write(data)
    return len(data)


def end(file: BinaryIO) -> None:
    """Write what a record ends with that has become too long."""
    file.write(ENDED)


def has_ended(path: Path) -> bool:
    """Return whether a record exists that has become too long."""
    if not path.exists() or path.stat().st_size < len(ENDED):
        return False
    with path.open("rb") as file:
        file.seek(-len(ENDED), SEEK_END)
        return file.read() == ENDED


def _framed(entry: Entry) -> bytes:
    content = entry.SerializeToString()
    return LENGTH.pack(len(content)) + content


ENDED = _framed(Entry(ended=Ended()))


def read(file: BinaryIO) -> Iterator[Entry]:
    """Yield the entries; raise BadRecord where the file is not a record."""
    if file.read(len(MAGIC)) != MAGIC:
        raise BadRecord("it does not begin as a record does; was it made by this version?")
    position = len(MAGIC)
    while prefix := file.read(LENGTH.size):
        if len(prefix) < LENGTH.size:
            raise BadRecord(f"it ends in the middle of an entry, at byte {position}")
        (length,) = LENGTH.unpack(prefix)
        if length > MAX_ENTRY_BYTES:
            raise BadRecord(f"the entry at byte {position} claims {length:,} bytes")
        content = file.read(length)
        if len(content) < length:
            raise BadRecord(f"it ends in the middle of an entry, at byte {position}")
        yield _decode(content, position)
        position += LENGTH.size + length


def _decode(content: bytes, position: int) -> Entry:
    try:
        entry = Entry.FromString(content)
    except DecodeError as error:
        raise BadRecord(f"the entry at byte {position} is malformed") from error
    kind = entry.WhichOneof("entry")
    if kind is None:
        raise BadRecord(f"the entry at byte {position} is of no known kind")
    if (kind == "header") != (position == len(MAGIC)):
        raise BadRecord(f"the entry at byte {position} is a {kind}; the header comes first, once")
    return entry
