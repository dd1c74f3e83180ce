"""Messages between an application and its host's stack, on a Unix stream socket.

application                 stack (the end that asks for a service)
REQUEST {service, host, port, …} ->
                        <-  RESULT {…} …, then CLOSE {summary} or FAILED {reason, text, summary}

application                 stack (the end that is asked)
LISTEN {port, service}  ->  listening lasts as long as this socket
                        <-  DONE
ACCEPT {port}           ->  on a socket of its own
                        <-  DONE {peer}, then RESULT {…} …, then CLOSE {summary} or FAILED

Where a service carries bytes (sdc), at the end that asks:
                        <-  DONE {summary}: there is a way for them
DATA bytes              ->  as often as wanted
                        <-  DONE {summary}: the other end holds every byte
CLOSE                   ->
                        <-  CLOSE {summary}: the other end has verified all of them
and at the end that is asked, in the place of results:
                        <-  DATA bytes …

Where a service leaves something to be used, as pairs in memory, at either end:
                        <-  RESULT {…} …, then DONE {summary}: it has come
ASK {…}                 ->  as often as wanted
                        <-  DONE {…}, or DONE {refused, reason}
CLOSE                   ->  of the end that has asked for the service, or its socket closes
                        <-  CLOSE {summary}, at both ends

application                 stack
WATCH {session, history} -> of this host alone, for as long as this socket; session 0: all
                        <-  DONE, then EVENT record (wire.events) …

application                 stack
INTERCEPT {attack, …}   ->  of the light that comes to this host's first fibre
                        <-  DONE, then RESULT {…} for each block that was sent on
CLOSE                   ->
                        <-  CLOSE {summary}

application                 stack's processing unit
PROCESS                 ->
                        <-  DONE {node, nodes}: name of this host, addresses of all by name
DATA message            ->  of NetQASM (applications.processing_unit.messages), as often as wanted
                        <-  DATA messages of NetQASM, the last of which says that it is done
ASK {look, entangled}   ->  for the state of a qubit, where it is simulated
                        <-  DONE {real, imaginary}, or DONE {refused, reason}
CLOSE                   ->
                        <-  CLOSE
"""

import json
import struct
from enum import IntEnum
from typing import Any

from wire.malformed import MalformedPacket

HEADER = struct.Struct("!BI")
MAX_PAYLOAD = 1 << 20
RESEND, SPLIT = ATTACKS = ("resend", "split")  # of INTERCEPT


class Call(IntEnum):
    LISTEN = 2
    ACCEPT = 3
    DATA = 4
    CLOSE = 5
    DONE = 6
    FAILED = 7
    WATCH = 8
    EVENT = 9
    REQUEST = 10
    RESULT = 11
    ASK = 12
    INTERCEPT = 13
    PROCESS = 14


def encode(call: Call, payload: bytes = b"") -> bytes:
    """Return a message that carries raw bytes, at most MAX_PAYLOAD of them."""
    return HEADER.pack(call, len(payload)) + payload


def encode_fields(call: Call, **fields: Any) -> bytes:
    return encode(call, json.dumps(fields).encode())


def decode_header(header: bytes) -> tuple[Call, int]:
    """Return call and payload length; raise MalformedPacket if there is no such call."""
    number, length = HEADER.unpack(header)
    if number not in Call.__members__.values() or length > MAX_PAYLOAD:
        raise MalformedPacket(f"no such socket call: kind {number}, {length} bytes")
    return Call(number), length


def decode_fields(payload: bytes) -> dict[str, Any]:
    """Return the named fields of a message; raise MalformedPacket for anything else."""
    try:
        fields = json.loads(payload or b"{}")
    except (ValueError, RecursionError) as error:  # the latter for lists in lists in lists
        raise MalformedPacket(f"socket call is not JSON: {error}") from error
    if not isinstance(fields, dict):
        raise MalformedPacket("socket call is not a JSON object")
    return fields
