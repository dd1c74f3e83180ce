"""The scapy layers read and build the very bytes that wire/ encodes."""

import random
from dataclasses import fields
from pathlib import Path
from typing import Any

import pytest
from dissection import INTERFACES, datagram, segment
from dissector_scene import DEVICES, EVENT, KEY, METADATA, SEED, SETUP
from scapy.layers.l2 import Ether
from scapy.utils import rdpcap, wrpcap
from test_key_dissectors import MESSAGES, cut, envelope
from test_qkd import SEQUENCE, SESSION, TAG, whole

from applications.qkd.messages import QkdMessage, Sifted, unframe
from applications.qkd.scapy_keys import KEY_LAYERS, QKey, key_messages, split
from views.dissection.scapy_layers import LAYERS, QDevice, QEvent, QMeta, QMetaStream
from wire.device import DEVICE_PORT, Datagram, DeviceSettings
from wire.events import encode_record
from wire.malformed import MalformedPacket
from wire.metadata.decoding import decode
from wire.metadata.header import Message
from wire.pcapng import Packet, Writer


def check_fields(message: Message, packet: Any) -> None:
    if not message.FIELDS.size:
        return  # scapy makes no layer of no bytes
    layer = packet[LAYERS[message.KIND]]
    for item in fields(message)[1:]:
        want, seen = getattr(message, item.name), getattr(layer, item.name)
        if isinstance(want, tuple) and want and not isinstance(want[0], int):
            for element, packet in zip(want, seen, strict=True):
                for name, value in vars(element).items():
                    shown = getattr(packet, "interface" if name == "name" else name)
                    assert plain(shown, value) == value
        elif isinstance(want, DeviceSettings):
            assert len(seen) == 4 * len(fields(want))
        else:
            assert plain(seen, want) == want, item.name


def plain(seen: Any, want: Any) -> Any:
    if isinstance(want, str) and isinstance(seen, bytes):
        return seen.rstrip(b"\0").decode()
    return tuple(seen) if isinstance(want, tuple) else seen


@pytest.mark.parametrize("message", [*METADATA, *DEVICES], ids=lambda m: type(m).__name__)
def test_a_layer_has_the_fields_and_builds_the_bytes_again(message: Message) -> None:
    data = message.encode()
    packet = QMeta(data)
    assert packet.session == message.session
    check_fields(message, packet)
    packet.length = None
    for name in [field.name for field in packet.payload.fields_desc]:
        if name.endswith("_count"):
            setattr(packet.payload, name, None)
    packet.clear_cache()
    assert bytes(packet) == data


def test_what_scapy_builds_python_decodes() -> None:
    layer = LAYERS[SETUP.KIND]
    setup = layer(service="SDC", handshake=1, source="10.0.0.3", pairs=1, frame_bytes=2, rate_hz=3)
    message = decode(bytes(QMeta(session=5, kind=SETUP.KIND) / setup))
    assert (message.session, message.source, message.rate_hz) == (5, "10.0.0.3", 3)  # type: ignore[attr-defined]


def test_a_segment_may_hold_several_messages() -> None:
    data = b"".join(message.encode() for message in METADATA)
    packet = Ether(segment(data))
    messages = packet[QMetaStream].messages
    assert [message.kind for message in messages] == [message.KIND for message in METADATA]
    assert bytes(packet[QMetaStream]) == data


@pytest.mark.parametrize("message", DEVICES, ids=lambda m: type(m).__name__)
def test_a_datagram_has_message_host_and_hmac(message: Message) -> None:
    data = Datagram(message, "alice", 99).seal(KEY, Datagram.FROM_HOST)
    packet = Ether(datagram(data, DEVICE_PORT))[QDevice]
    assert (packet.host.rstrip(b"\0"), packet.number, packet.hmac) == (b"alice", 99, data[-16:])
    check_fields(message, packet.messages[0])
    assert bytes(packet) == data


def test_rdpcap_reads_events(tmp_path: Path) -> None:
    file = tmp_path / "quantum.pcapng"
    data = encode_record(EVENT)
    with file.open("wb") as opened:
        Writer(opened, INTERFACES).write(Packet(EVENT.time_ns, data, len(data), 1))
    (packet,) = rdpcap(str(file))
    assert packet[QEvent].event == EVENT
    assert bytes(packet) == data
    with pytest.raises(MalformedPacket):
        _ = QEvent(b"\0" * 9).event


@pytest.mark.parametrize("message", MESSAGES, ids=lambda m: type(m).__name__)
def test_a_message_of_keys_has_the_fields_and_builds_the_bytes_again(message: QkdMessage) -> None:
    data = whole(message)
    (packet,) = split(data + data[:5])
    assert (packet.session, packet.sequence) == (SESSION, SEQUENCE)
    layer = packet[KEY_LAYERS[message.KIND]]
    for item in fields(message):
        want = getattr(message, item.name)
        assert plain(getattr(layer, item.name), want) == want, item.name
    assert layer.authentication == TAG
    packet.length = None
    packet.clear_cache()
    assert bytes(packet) == data


def test_what_scapy_builds_of_keys_python_opens() -> None:
    layer = KEY_LAYERS[Sifted.KIND](block=1, clicks=3, kept=b"\xa0", authentication=TAG)
    sealed = unframe(bytes(QKey(session=5, sequence=6, kind=Sifted.KIND) / layer))
    assert (sealed.session, sealed.sequence, sealed.tag) == (5, 6, TAG)
    assert sealed.open() == Sifted(1, 3, b"\xa0")


def test_messages_of_keys_are_read_from_a_capture_of_segments(tmp_path: Path) -> None:
    draw = random.Random(SEED)
    stream = b"".join(whole(message) for message in MESSAGES)
    sent = SETUP.encode() + b"".join(envelope(piece) for piece in cut(draw, stream, 10))
    frames, place = [], 1
    for piece in cut(draw, sent, 25):  # every segment comes twice
        frames += [Ether(segment(piece, seq=place))] * 2
        place += len(piece)
    file = tmp_path / "s1-eth1.pcap"
    wrpcap(str(file), frames)
    packets = rdpcap(str(file))
    read = key_messages(packets, "10.0.0.1")
    assert [bytes(message) for message in read] == [whole(message) for message in MESSAGES]
    assert key_messages(packets, "10.0.0.2") == []
    with_a_gap = [*packets[:20], *packets[22:]]
    assert 0 < len(key_messages(with_a_gap, "10.0.0.1")) < len(MESSAGES)
