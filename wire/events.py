"""Events of the dispatcher outside of gRPC: a line, JSON, a packet of a capture.

A packet is a magic number, a version and the protobuf message Event. Fields that Event gets
later appear everywhere by themselves: a reader that does not know them keeps them.
"""

import json
import struct
from datetime import UTC, datetime
from functools import lru_cache
from typing import Any

from google.protobuf.json_format import MessageToDict
from google.protobuf.message import DecodeError

from wire.dispatcher_pb2 import Event
from wire.malformed import MalformedPacket

RECORD = struct.Struct("!HBx")  # magic, version; then the message
MAGIC = 0x5145  # "QE"
VERSION = 1
DROPPED = "dropped"  # kind of the event that counts those that were not sent
UNWRITTEN = "unwritten"  # the last of what a node has caused that is in log and capture
_SHOWN = frozenset(
    {"time_ns", "node", "kind", "block", "port", "photons", "lost", "detail", "photon"}
)
_encoded = json.JSONEncoder().encode
_LATER = frozenset(Event.DESCRIPTOR.fields_by_name) - _SHOWN


def format_line(event: Event) -> str:
    """Return the event as one line; its time is that of the packet captures, in UTC."""
    parts = [format_time(event.time_ns), f"{event.node:<8}", f"{event.kind:<13}"]
    if event.HasField("block"):
        block = event.block
        parts.append(f"session={block.session:016x} block={block.number}/{block.half}")
    if event.photon:
        parts.append(f"photon={event.photon}")
    if event.port:
        parts.append(f"port={event.port}")
    if event.photons:
        parts.append(f"photons={event.photons}")
    if event.lost:
        parts.append(f"lost={event.lost}")
    parts += [f"{name}={value}" for name, value in _further(event).items()]
    if event.detail:
        parts.append(event.detail)
    return " ".join(parts)


def format_time(time_ns: int) -> str:
    seconds, nanoseconds = divmod(time_ns, 1_000_000_000)
    return f"{_moment(seconds)}.{nanoseconds:09d}Z"


def to_json(event: Event) -> dict[str, Any]:
    time_ns = event.time_ns
    return {"time": format_time(time_ns), "time_ns": time_ns, **to_fields(event)}


def to_fields(event: Event) -> dict[str, Any]:
    """Return what it says but its time; a session is 16 hexadecimal digits, as in the log."""
    fields: dict[str, Any] = {"node": event.node, "kind": event.kind}
    if event.HasField("block"):
        block = event.block
        fields |= {
            "session": f"{block.session:016x}",
            "block": block.number,
            "half": block.half,
        }
    values = {
        "photon": event.photon,
        "port": event.port,
        "photons": event.photons,
        "lost": event.lost,
    }
    fields |= {name: value for name, value in values.items() if value}
    fields |= _further(event)
    return {**fields, "detail": event.detail} if event.detail else fields


def fields_text(event: Event) -> str:
    """Return `to_fields` as JSON without its braces: a live view has thousands of them a second."""
    if _LATER:
        return json.dumps(to_fields(event), separators=(",", ":"))[1:-1]
    text = f'"node":{_quoted(event.node)},"kind":{_quoted(event.kind)}'
    if event.HasField("block"):
        block = event.block
        text += f',"session":"{block.session:016x}","block":{block.number},"half":{block.half}'
    if event.photon:
        text += f',"photon":{event.photon}'
    if event.port:
        text += f',"port":{_quoted(event.port)}'
    if event.photons:
        text += f',"photons":{event.photons}'
    if event.lost:
        text += f',"lost":{event.lost}'
    if event.detail:
        text += f',"detail":{_encoded(event.detail)}'
    return text


def encode_record(event: Event) -> bytes:
    return RECORD.pack(MAGIC, VERSION) + event.SerializeToString()


def decode_record(data: bytes) -> Event:
    """Read a packet of a capture; raise MalformedPacket unless it is an event."""
    if len(data) < RECORD.size or RECORD.unpack_from(data) != (MAGIC, VERSION):
        raise MalformedPacket(f"not an event of version {VERSION}: {data[: RECORD.size].hex()}")
    try:
        return Event.FromString(data[RECORD.size :])
    except DecodeError as error:
        raise MalformedPacket(f"event of {len(data)} bytes: {error}") from error


def _further(event: Event) -> dict[str, Any]:
    if not _LATER:
        return {}
    further = [field.name for field, _value in event.ListFields() if field.name in _LATER]
    if not further:
        return {}
    everything = MessageToDict(event, preserving_proto_field_name=True)
    return {name: everything[name] for name in further}


@lru_cache(maxsize=10_000)
def _quoted(name: str) -> str:
    """Return a name as JSON: of nodes and ports there are few."""
    return _encoded(name)


@lru_cache(maxsize=2)
def _moment(seconds: int) -> str:
    """Return a second of the clock; thousands of events share one."""
    return datetime.fromtimestamp(seconds, UTC).strftime("%Y-%m-%dT%H:%M:%S")
