"""Messages of each kind, and what tshark shows of them."""

import hmac
import random
from contextlib import suppress

from applications.keys.route_messages import Hop, KeyLinks, KeyRoute, KeyRouteRequest, LinkState
from views.dissection.layout import Layout
from wire.device import (
    Datagram,
    DevicePort,
    DeviceQuery,
    DeviceReport,
    DeviceSettings,
    SessionQuery,
    SetDevice,
    Subscribe,
    open_sealed,
)
from wire.dispatcher_pb2 import BlockId, Event
from wire.events import decode_record
from wire.malformed import MalformedPacket
from wire.metadata.blocks import Block, Emission, Emit, Emitted, Finish, Frame, Report
from wire.metadata.decoding import decode, message_length
from wire.metadata.header import HEADER, Message
from wire.metadata.setup import Answer, Setup
from wire.metadata.values import Envelope, Topic, Values
from wire.metadata.vocabulary import Handshake, Reason, Service, Verdict
from wire.monitor_messages import MonitorCommand, PreemptMonitor, Quantity, SessionEstimate
from wire.outcomes import Pauli

SEED = 7
KEY = "00" * 32
SETUP = Setup(
    session=0x8102030405060708,
    service=Service.SDC,
    handshake=Handshake.PER_PAIR,
    source="10.0.0.3",
    pairs=65_536,
    frame_bytes=257,
    rate_hz=4_000_000_000,
    port=7,
    block=11,
    encoding=0b00_11_10_01,
    fec=3,
    interleave=1,
    polarization=4,
    memory=5,
    wavelength_pm=1_550_121,
    phase_mrad=-6,
    sync_window_ps=12,
    fidelity_ppm=13,
    priority=14,
    deadline_ms=15_000,
    verdict=Verdict.REFUSED,
    rotation=Pauli.XZ,
    reason=Reason.BUSY,
)
METADATA: list[Message] = [
    SETUP,
    Answer(2, Reason.OK),
    Answer(2, Reason.OK, "", 3, 0b00_11_10_01),
    Answer(3, Reason.TOO_NOISY, "später"),
    Emit(4, 5, 6, 7),
    Emission(4, 5, 6, 7),
    Emitted(4, 5),
    Block(5, 8, 4 * 9 + 4 * 10 + 1, 1, 1 << 63, (Frame(6, 9, 0xDEADBEEF), Frame(7, 10, 11))),
    Block(6, 12, 0, 0, 13),
    Report(7, 8, 9, 2, 10, 11, 12, (11, 12), b"\x80\x01"),
    Report(8, 8, 9, 0, 10, 11, 12),
    Finish(9, (1 << 40) + 1, bytes(range(32))),
    Values(10, Topic.ARRIVED, 1, 14, 11, b"\xff\xe0"),
    Envelope(11, 200, b"own format"),
]
SETTINGS = DeviceSettings(rate_hz=1_000_000, frame_bytes=64)
REPORT = DeviceReport(
    1,
    sending=2,
    receiving=3,
    serving=4,
    pairs_sent=5,
    pairs_made=6,
    pairs_received=7,
    pairs_lost=(1 << 64) - 1,
    symbol_errors=9,
    repeated_frames=10,
    rate_hz=11,
    frame_bytes=12,
    fec=13,
    interleave=18,
    wavelength_pm=14,
    period_ms=15,
    lost_ppm=16,
    symbol_error_ppm=17,
    alarm=19,
    monitor=20,
    monitor_compared=21,
    monitor_errors=22,
    monitor_tests=23,
    monitor_end=Reason.BUSY,
    settings=SETTINGS,
    ports=(DevicePort("alice-q0", True), DevicePort("alice-q1", False)),
)
DEVICES: list[Message] = [
    DeviceQuery(1),
    Subscribe(2, 3, 4, 5),
    SetDevice(3, SETTINGS),
    MonitorCommand(
        8, 1 << 63, "10.0.0.1", "10.0.0.2", 2000, 1024, 100_000, 0.5, 0.25, 0.125, 0.0625
    ),
    PreemptMonitor(9, 7),
    SessionQuery(10, 8),
    SessionEstimate(0, 8, Quantity.FIDELITY, 0.875, 0.75, 0.9375),
    REPORT,
    KeyLinks(
        5, (LinkState("10.0.0.2", 1, 2, 9, 3, 4, True), LinkState("10.0.0.3", 5, 6, 11, 7, 8))
    ),
    KeyRouteRequest(6, "10.0.0.3", 9, "sae-alice", "web"),
    KeyRoute(7, 10, 11, (Hop("10.0.0.1"), Hop("10.0.0.2", b"\x12" * 16))),
    Answer(5, Reason.NOT_ALLOWED, "no"),
]


def plain(text: str) -> float | str:
    """Return a number that tshark shows, as a number; anything else as it is."""
    for number in (lambda: int(text, 0), lambda: float(text)):
        with suppress(ValueError):
            return number()
    return text


def astuple_of(row: dict[str, list[str]]) -> tuple[str, ...]:
    return tuple("|".join(values) for values in row.values())


def mutated(draw: random.Random, data: bytes) -> bytes:
    """Return a message with some bytes changed, cut or added; mostly its length is right."""
    body = bytearray(data)
    for _ in range(draw.randrange(4)):
        body[draw.randrange(len(body))] = draw.choice([0, 1, 2, 5, 0x7F, 0x80, 0xFF])
    if draw.random() < 0.3:
        body = body[: draw.randrange(HEADER.size, len(body) + 1)]
    if draw.random() < 0.3:
        body += draw.randbytes(draw.randrange(1, 20))
    if draw.random() < 0.7:
        body[4:8] = len(body).to_bytes(4, "big")
    return bytes(body)


def with_other_values(messages: list[Message], layouts: list[Layout]) -> list[bytes]:
    """Return each message with each of its fixed fields 0, all ones, or another number."""
    known = {layout.number: layout for layout in layouts}
    changed = []
    for message in messages:
        for field in known[message.KIND].fields:
            numbers = range(256) if field.size == 1 else range(24)
            wholes = [number.to_bytes(field.size, "big") for number in numbers]
            for whole in [*wholes, b"\xff" * field.size]:
                data = bytearray(message.encode())
                start = HEADER.size + field.offset
                data[start : start + field.size] = whole
                changed.append(bytes(data))
    return changed


def refused(data: bytes) -> bool:
    """Return whether Python finds one of the messages malformed that bytes begin with."""
    try:
        while data and (length := message_length(data)) is not None and length <= len(data):
            decode(data[:length])
            data = data[length:]
    except MalformedPacket:
        return True
    return False


def inside(draw: random.Random, whole: bytes) -> bytes:
    """Return a datagram, not yet signed, whose message is changed and whose length is right."""
    message, trailer = whole[:-56], whole[-56:-16]
    changed = bytearray(mutated(draw, message))
    changed[4:8] = len(changed).to_bytes(4, "big")
    return bytes(changed) + trailer


def sign(data: bytes) -> bytes:
    key = bytes.fromhex(KEY)
    return data + hmac.digest(key, Datagram.FROM_HOST + data, "sha256")[:16]


def device_refused(data: bytes) -> bool:
    try:
        open_sealed(data, KEY, Datagram.FROM_HOST)
    except MalformedPacket:
        return True
    return False


EVENT = Event(
    time_ns=1_700_000_000_123_456_789,
    node="bob",
    kind="bell-measure",
    block=BlockId(session=0xFEDCBA9876543210, number=3, half=1),
    port="bob-q0",
    photons=1_000_000,
    lost=7,
    photon=5,
    first=["Z 1"],
    detail="with 3/0: Phi+=8 später",
)


def event_refused(data: bytes) -> bool:
    try:
        decode_record(data)
    except MalformedPacket:
        return True
    return False
