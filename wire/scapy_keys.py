"""scapy layers of the messages of key distribution (wire/qkd.py): header, fields, tag."""

from collections.abc import Callable, Iterator
from typing import Any

from scapy.fields import (
    ByteField,
    Field,
    IntField,
    StrFixedLenField,
    StrLenField,
    XLongField,
    XShortField,
)
from scapy.packet import Packet, bind_layers

from wire import layout, qkd
from wire.layout import Layout, Tail
from wire.qkd import HEADER, TAG_BYTES
from wire.scapy_fields import scapy_field


class QKey(Packet):
    """The header; what follows it is of its kind."""

    name = "key distribution"
    fields_desc = [  # noqa: RUF012 (scapy's own way)
        XShortField("magic", qkd.MAGIC),
        ByteField("version", qkd.VERSION),
        ByteField("kind", 0),
        IntField("length", None),
        XLongField("session", 0),
        IntField("sequence", 0),
    ]

    def post_build(self, packet: bytes, payload: bytes) -> bytes:
        """Fill in the length."""
        whole = packet + payload
        if self.length is None:
            whole = whole[:4] + len(whole).to_bytes(4, "big") + whole[8:]
        return whole


def split(stream: bytes) -> Iterator[QKey]:
    """Yield the whole messages that a stream begins with; MalformedPacket for what is none."""
    while (length := qkd.message_length(stream)) is not None and length <= len(stream):
        yield QKey(stream[:length])
        stream = stream[length:]


def _size_of(tail: Tail) -> Callable[[Any], int]:
    def size(packet: Any) -> int:
        count = getattr(packet, tail.count)
        if isinstance(count, bytes):  # as many as these have ones
            count = int.from_bytes(count, "big").bit_count()
        return int((tail.width * count + 7) // 8)

    return size


def _text_size(packet: Any) -> int:
    header = packet.underlayer
    fixed = HEADER.size + TAG_BYTES + qkd.Abort.FIELDS.size
    return max((header.length or 0) - fixed, 0) if header is not None else 0


def _tail_field(tail: Tail) -> Field[Any, Any]:
    size = _text_size if tail.kind == layout.TEXT else _size_of(tail)
    return StrLenField(tail.name, b"", length_from=size)


def _layer(kind: Layout) -> type[Packet]:
    fields = [scapy_field(described) for described in kind.fields]
    fields += [_tail_field(tail) for tail in kind.tails]
    fields.append(StrFixedLenField("authentication", b"", TAG_BYTES))
    made = {"fields_desc": fields, "name": f"key distribution: {kind.name}"}
    return type(f"QKey{kind.name}", (Packet,), made)


KEY_LAYERS = {kind.number: _layer(kind) for kind in layout.key_layouts()}
for _number, _bound in KEY_LAYERS.items():
    bind_layers(QKey, _bound, kind=_number)
globals().update({layer.__name__: layer for layer in KEY_LAYERS.values()})
