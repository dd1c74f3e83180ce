"""The fields of messages as scapy has them, from views.dissection.layout; their frame."""

from typing import Any

from scapy.fields import (
    ByteEnumField,
    ByteField,
    Field,
    IEEEDoubleField,
    IntField,
    IPField,
    LongField,
    ShortEnumField,
    ShortField,
    SignedIntField,
    StrFixedLenField,
    XByteField,
)
from scapy.packet import Packet

from views.dissection import layout
from wire.metadata.vocabulary import PAPER_ENCODING

_NUMBERS = {1: ByteField, 2: ShortField, 4: IntField, 8: LongField}
_RENAMED = {"name": "interface"}  # scapy's packets have a name of their own
_NAMED = {1: ByteEnumField, 2: ShortEnumField}


class Framed(Packet):
    """A message whose header has its length, in bytes 4 to 7."""

    def post_build(self, packet: bytes, payload: bytes) -> bytes:
        whole = packet + payload
        if self.length is None:
            whole = whole[:4] + len(whole).to_bytes(4, "big") + whole[8:]
        return whole


def scapy_field(described: layout.Field) -> Field[Any, Any]:
    name = _RENAMED.get(described.name, described.name)
    size = described.size
    if described.kind == "ipv4":
        return IPField(name, "0.0.0.0")  # noqa: S104 (a field's default, no address to bind to)
    if described.kind in ("bytes", "text"):
        return StrFixedLenField(name, b"", size)
    if described.kind == "int":
        return SignedIntField(name, 0)
    if described.kind == "double":
        return IEEEDoubleField(name, 0)
    if described.values and size in _NAMED:
        return _NAMED[size](name, 0, dict(described.values))
    if name == "encoding":
        return XByteField(name, PAPER_ENCODING)
    return _NUMBERS[size](name, 0)
