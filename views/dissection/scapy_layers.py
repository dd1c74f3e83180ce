"""scapy layers of quantum metadata, of node-agent messages and of quantum events.

    >>> from scapy.all import *
    >>> import views.dissection.scapy_layers
    >>> rdpcap("runs/latest/s1-eth1.pcap").filter(lambda p: "QMetaSetup" in p)[0].show()

Messages of key distribution, which travel in envelopes of quantum metadata:

    >>> from applications.qkd.scapy_keys import key_messages
    >>> key_messages(rdpcap("runs/latest/s1-eth1.pcap"), "10.0.0.1")[0].show()

Their fields are those of the classes in wire/, which know the sizes, too. scapy reads
leniently: it is wire/ that says what is malformed.
"""

from typing import Any

from scapy.config import conf
from scapy.fields import (
    ByteField,
    Field,
    FieldLenField,
    FieldListField,
    IntField,
    LongField,
    PacketListField,
    StrField,
    StrFixedLenField,
    XLongField,
    XShortField,
)
from scapy.layers.inet import TCP, UDP
from scapy.packet import Packet, bind_layers

from views.dissection import layout
from views.dissection.layout import Layout, Tail
from views.dissection.scapy_fields import Framed, scapy_field
from wire import device, events
from wire.dispatcher_pb2 import Event
from wire.metadata import header
from wire.metadata.decoding import KINDS
from wire.pcapng import LINKTYPE_USER0


class QMeta(Framed):
    """The header; what follows it is of its kind."""

    name = "quantum metadata"
    fields_desc = [  # noqa: RUF012 (scapy's own way)
        XShortField("magic", header.MAGIC),
        ByteField("version", header.VERSION),
        ByteField("kind", 0),
        IntField("length", None),
        XLongField("session", 0),
    ]

    def extract_padding(self, data: bytes) -> tuple[bytes, bytes]:
        size = max((self.length or 0) - header.HEADER.size, 0)
        return data[:size], data[size:]


class QMetaStream(Packet):
    """The messages in one TCP segment."""

    name = "quantum metadata messages"
    fields_desc = [PacketListField("messages", [], QMeta)]  # noqa: RUF012


class QDevice(Packet):
    """A datagram of controller or node agent."""

    name = "quantum device datagram"
    fields_desc = [  # noqa: RUF012
        PacketListField("messages", [], QMeta, length_from=lambda packet: packet.message_bytes),
        StrFixedLenField("host", b"", device.TRAILER.size - 8),
        LongField("number", 0),
        StrFixedLenField("hmac", b"", device.TAG_BYTES),
    ]
    message_bytes = 0

    def pre_dissect(self, data: bytes) -> bytes:
        """Note how long the message is: what the trailer leaves."""
        self.message_bytes = max(len(data) - device.TRAILER.size - device.TAG_BYTES, 0)
        return data


class QEvent(Packet):
    """An event of a quantum.pcapng; `event` is its message, decoded."""

    name = "quantum event"
    fields_desc = [  # noqa: RUF012
        XShortField("magic", events.MAGIC),
        ByteField("version", events.VERSION),
        ByteField("reserved", 0),
        StrField("message", b""),
    ]

    @property
    def event(self) -> Event:
        """The message; MalformedPacket if it is not one."""
        return events.decode_record(bytes(self))


def _element_layer(tail: Tail, owner: str) -> type[Packet]:
    fields = [scapy_field(described) for described in tail.element]
    members = {"fields_desc": fields, "extract_padding": lambda _packet, data: (b"", data)}
    return type(f"{owner}{tail.name.title()}", (Packet,), {**members, "name": tail.name})


def _tail_fields(kind: Layout, prefix: str) -> list[Field[Any, Any]]:
    fields: list[Field[Any, Any]] = []
    for tail in kind.tails:
        count = f"{tail.name}_count"
        if tail.kind in (layout.TEXT, layout.BYTES):
            fields.append(StrField(tail.name, b""))
        elif len(tail.element) == 1:
            number = scapy_field(tail.element[0])
            fields.append(FieldListField(tail.name, [], number, count_from=_reader(count)))
        elif tail.kind == layout.COUNTED:
            layer = _element_layer(tail, prefix + kind.name)
            fields.append(PacketListField(tail.name, [], layer, count_from=_reader(count)))
        else:
            layer = _element_layer(tail, prefix + kind.name)
            fields.append(PacketListField(tail.name, [], layer))
    return fields


def _reader(name: str) -> Any:
    return lambda packet: getattr(packet, name)


def _counted(described: layout.Field, kind: Layout) -> Field[Any, Any]:
    lists = [tail.name for tail in kind.tails if described.name == f"{tail.name}_count"]
    if lists:
        return FieldLenField(described.name, None, count_of=lists[0], fmt="!H")
    return scapy_field(described)


def _layers(kinds: list[Layout]) -> dict[int, type[Packet]]:
    """Return a layer for each kind, bound to the header."""
    made = {}
    for kind in kinds:
        fields = [_counted(described, kind) for described in kind.fields]
        fields += _tail_fields(kind, "QMeta")
        names = {"fields_desc": fields, "name": f"quantum metadata: {kind.name}"}
        made[kind.number] = type(f"QMeta{kind.name}", (Packet,), names)
        bind_layers(QMeta, made[kind.number], kind=kind.number)
    return made


LAYERS = _layers(
    [
        *layout.metadata_layouts(),
        *(kind for kind in layout.device_layouts() if kind.number not in KINDS),
    ]
)
globals().update({layer.__name__: layer for layer in LAYERS.values()})
for _end in ("sport", "dport"):
    bind_layers(TCP, QMetaStream, **{_end: header.METADATA_PORT})
    bind_layers(UDP, QDevice, **{_end: device.DEVICE_PORT})
conf.l2types.register(LINKTYPE_USER0, QEvent)
