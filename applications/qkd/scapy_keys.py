"""scapy layers of the messages of key distribution (messages.py), and where to find them."""

from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator
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
from scapy.layers.inet import IP, TCP
from scapy.packet import Packet, bind_layers

from applications.qkd import messages as qkd
from applications.qkd.dissection import key_layouts
from applications.qkd.messages import HEADER, TAG_BYTES
from views.dissection import layout
from views.dissection.layout import Layout, Tail
from views.dissection.scapy_fields import Framed, scapy_field
from wire.metadata.decoding import decode, message_length
from wire.metadata.header import METADATA_PORT
from wire.metadata.values import Envelope, Topic


class QKey(Framed):
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


def split(stream: bytes) -> Iterator[QKey]:
    """Yield the whole messages that a stream begins with; MalformedPacket for anything else."""
    while (length := qkd.message_length(stream)) is not None and length <= len(stream):
        yield QKey(stream[:length])
        stream = stream[length:]


def key_messages(packets: Iterable[Packet], sender: str) -> list[QKey]:
    """Return what a host (by its address) says of keys, from packets of one link.

    Raise MalformedPacket for what cannot be that. Leave out bytes behind a gap.
    """
    data: defaultdict[int, bytes] = defaultdict(bytes)  # by session
    for stream in _streams(packets, sender):
        left = stream
        while (length := message_length(left)) is not None and length <= len(left):
            message = decode(left[:length])
            if isinstance(message, Envelope) and message.topic == Topic.KEYS:
                data[message.session] += message.content
            left = left[length:]
    return [message for stream in data.values() for message in split(stream)]


def _streams(packets: Iterable[Packet], sender: str) -> Iterator[bytes]:
    """Yield what a host sends over each of its connections for quantum metadata."""
    segments: defaultdict[tuple[int, int], list[tuple[int, bytes]]] = defaultdict(list)
    for packet in packets:
        if TCP not in packet or IP not in packet or packet[IP].src != sender:
            continue
        ip, tcp = packet[IP], packet[TCP]
        size = ip.len - 4 * (ip.ihl + tcp.dataofs)  # padding may follow
        if size > 0 and METADATA_PORT in (tcp.sport, tcp.dport):
            data = tcp.original[4 * tcp.dataofs :][:size]
            segments[tcp.sport, tcp.dport].append((tcp.seq, data))
    for sent in segments.values():
        yield _joined(sent)


def _joined(segments: list[tuple[int, bytes]]) -> bytes:
    """Return the bytes of segments by their sequence numbers, up to the first gap."""
    start = segments[0][0]
    joined = b""
    for place, data in sorted(((seq - start) % (1 << 32), data) for seq, data in segments):
        if place > len(joined):
            break
        joined += data[len(joined) - place :]
    return joined


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


KEY_LAYERS = {kind.number: _layer(kind) for kind in key_layouts()}
for _number, _bound in KEY_LAYERS.items():
    bind_layers(QKey, _bound, kind=_number)
globals().update({layer.__name__: layer for layer in KEY_LAYERS.values()})
