"""OpenFlow 1.4 as bytes: framing, and the few messages that the agent itself reads or writes.

Everything else passes through the agent unread. Constants carry the names of the
specification (from os_ken); os_ken's own parser of flow updates fails on all but the
initial ones, so they are taken apart here.
"""

import struct
from collections.abc import Iterator
from dataclasses import dataclass

from os_ken.ofproto import ofproto_v1_4 as ofp

from wire.metadata import MalformedPacket

HEADER = struct.Struct(ofp.OFP_HEADER_PACK_STR)  # version, type, length, xid
MULTIPART = struct.Struct("!HH4x")  # type, flags
UPDATE = struct.Struct(ofp.OFP_FLOW_UPDATE_FULL_0_PACK_STR)
PORT = struct.Struct(ofp.OFP_PORT_PACK_STR)  # number, length, address, name, config, state
PORT_REASONS = 1 << ofp.OFPPR_ADD | 1 << ofp.OFPPR_DELETE | 1 << ofp.OFPPR_MODIFY
OXM = struct.Struct("!HBB")  # class, field << 1 | has_mask, length of the value
MATCH_HEADER = 4  # ofp_match: type, length, then the OXM fields
IN_PORT = ofp.OFPXMT_OFB_IN_PORT << 1
ONE_OUTPUT = struct.Struct("!HH4xHHI8x")  # an instruction that holds one output action
ADDED, REMOVED, PAUSED, RESUMED = (
    ofp.OFPFME_ADDED,
    ofp.OFPFME_REMOVED,
    ofp.OFPFME_PAUSED,
    ofp.OFPFME_RESUMED,
)


@dataclass(frozen=True)
class FlowEntry:
    """What the agent needs to know of a flow entry; priority and match identify it."""

    priority: int
    match: bytes  # the OXM fields as they were sent
    in_port: int | None  # None: any
    other_fields: bool  # the match asks for more than the port
    out_port: int | None  # None: the entry does anything but output to one port

    def __str__(self) -> str:
        more = " and more" if self.other_fields else ""
        action = "other actions" if self.out_port is None else f"output to {self.out_port:#x}"
        return f"priority {self.priority}, in_port {self.in_port}{more} -> {action}"


@dataclass(frozen=True)
class FlowUpdate:
    """One event of a flow monitor; no entry comes with PAUSED and RESUMED."""

    event: int
    entry: FlowEntry | None = None


@dataclass(frozen=True)
class PortState:
    """Whether a port of the bridge, and what is behind it, is up."""

    number: int
    up: bool


class Framer:
    """Cuts a byte stream into OpenFlow messages."""

    def __init__(self) -> None:
        self._buffer = b""

    def feed(self, data: bytes) -> list[bytes]:
        """Return the messages that data completes; raise MalformedPacket at a bad header."""
        self._buffer += data
        messages, start = [], 0
        while len(self._buffer) - start >= HEADER.size:
            length = _checked_length(self._buffer, start)
            if len(self._buffer) - start < length:
                break
            messages.append(self._buffer[start : start + length])
            start += length
        self._buffer = self._buffer[start:]
        return messages


def _checked_length(buffer: bytes, start: int) -> int:
    version, kind, length, _xid = HEADER.unpack_from(buffer, start)
    if version != ofp.OFP_VERSION and kind != ofp.OFPT_HELLO:
        raise MalformedPacket(
            f"OpenFlow version {version:#x}, not 1.4 ({ofp.OFP_VERSION:#x}), "
            f"in a message of type {kind}"
        )
    if length < HEADER.size:
        raise MalformedPacket(f"OpenFlow message of type {kind} with length {length}")
    return int(length)


def message_type(message: bytes) -> int:
    """Return the type of a message."""
    return message[1]


def transaction_id(message: bytes) -> int:
    """Return the transaction id (xid) of a message."""
    return int(HEADER.unpack_from(message)[3])


def encode(kind: int, xid: int, body: bytes = b"") -> bytes:
    """Return a message with the given type, transaction id and body."""
    return HEADER.pack(ofp.OFP_VERSION, kind, HEADER.size + len(body), xid) + body


def hello() -> bytes:
    """Return a HELLO that offers OpenFlow 1.4 alone."""
    bitmap = struct.pack("!HHI", ofp.OFPHET_VERSIONBITMAP, 8, 1 << ofp.OFP_VERSION)
    return encode(ofp.OFPT_HELLO, 0, bitmap)


def flow_monitor_request(xid: int) -> bytes:
    """Return a request for table 0 as it is and for each change of it from then on.

    Open vSwitch refuses OFPFMF_NO_ABBREV; only changes made on the same connection
    would be abbreviated, and the agent makes none.
    """
    flags = (
        ofp.OFPFMF_INITIAL
        | ofp.OFPFMF_ADD
        | ofp.OFPFMF_REMOVED
        | ofp.OFPFMF_MODIFY
        | ofp.OFPFMF_INSTRUCTIONS
    )
    any_match = struct.pack("!HH4x", ofp.OFPMT_OXM, MATCH_HEADER)
    request = struct.pack(
        ofp.OFP_FLOW_MONITOR_REQUEST_0_PACK_STR,
        1,
        ofp.OFPP_ANY,
        ofp.OFPG_ANY,
        flags,
        0,
        ofp.OFPFMC_ADD,
    )
    body = MULTIPART.pack(ofp.OFPMP_FLOW_MONITOR, 0) + request + any_match
    return encode(ofp.OFPT_MULTIPART_REQUEST, xid, body)


def port_watch(xid: int) -> bytes:
    """Return requests for the state of every port as it is and for each change of it.

    The agent's role on its own connection is EQUAL, for which the master's settings hold.
    """
    reasons = struct.pack(
        ofp.OFP_ASYNC_CONFIG_PROP_REASONS_PACK_STR,
        ofp.OFPACPT_PORT_STATUS_MASTER,
        ofp.OFP_ASYNC_CONFIG_PROP_REASONS_SIZE,
        PORT_REASONS,
    )
    ports = MULTIPART.pack(ofp.OFPMP_PORT_DESC, 0)
    return encode(ofp.OFPT_SET_ASYNC, xid, reasons) + encode(ofp.OFPT_MULTIPART_REQUEST, xid, ports)


def barrier_error(barrier_reply: bytes) -> bytes:
    """Return the error that a controller gets in place of this reply to its barrier.

    Type and code: the flow entries before the barrier failed, for a reason that
    OpenFlow 1.4 has no code for.
    """
    xid = transaction_id(barrier_reply)
    request = encode(ofp.OFPT_BARRIER_REQUEST, xid)
    failure = struct.pack("!HH", ofp.OFPET_FLOW_MOD_FAILED, ofp.OFPFMFC_UNKNOWN)
    return encode(ofp.OFPT_ERROR, xid, failure + request)


def error_code(message: bytes) -> tuple[int, int]:
    """Return type and code of an ERROR message; raise MalformedPacket if it has none."""
    if len(message) < HEADER.size + 4:
        raise MalformedPacket(f"OpenFlow error of {len(message)} bytes")
    kind, code = struct.unpack_from("!HH", message, HEADER.size)
    return kind, code


def flow_updates(message: bytes) -> list[FlowUpdate]:
    """Return the flow monitor's events in a multipart reply, none if it is another reply."""
    try:
        kind, _flags = MULTIPART.unpack_from(message, HEADER.size)
        if kind != ofp.OFPMP_FLOW_MONITOR:
            return []
        return list(_each_update(message))
    except struct.error as error:
        raise MalformedPacket(f"flow monitor: {error}") from error


def port_states(message: bytes) -> list[PortState]:
    """Return what a PORT_STATUS or a reply about ports says, none if it is another message."""
    try:
        if message_type(message) == ofp.OFPT_PORT_STATUS:
            offset, gone = ofp.OFP_PORT_STATUS_DESC_OFFSET, message[8] == ofp.OFPPR_DELETE
        elif MULTIPART.unpack_from(message, HEADER.size)[0] == ofp.OFPMP_PORT_DESC:
            offset, gone = HEADER.size + MULTIPART.size, False
        else:
            return []
        return list(_each_port(message, offset, gone))
    except (struct.error, IndexError) as error:
        raise MalformedPacket(f"description of ports: {error}") from error


def _each_port(message: bytes, offset: int, gone: bool) -> Iterator[PortState]:
    while offset < len(message):
        number, length, _address, _name, config, state = PORT.unpack_from(message, offset)
        if not PORT.size <= length <= len(message) - offset:
            raise MalformedPacket(f"description of port {number} with length {length}")
        down = config & ofp.OFPPC_PORT_DOWN or state & ofp.OFPPS_LINK_DOWN
        yield PortState(number, not (gone or down))
        offset += length


def _each_update(message: bytes) -> Iterator[FlowUpdate]:
    offset = HEADER.size + MULTIPART.size
    while offset < len(message):
        length, event = struct.unpack_from("!HH", message, offset)
        if not 8 <= length <= len(message) - offset:
            raise MalformedPacket(f"flow update with length {length}")
        update = message[offset : offset + length]
        yield FlowUpdate(event, _flow_entry(update) if event <= ofp.OFPFME_MODIFIED else None)
        offset += length


def _flow_entry(update: bytes) -> FlowEntry:
    priority = UPDATE.unpack_from(update)[6]
    _type, match_length = struct.unpack_from("!HH", update, UPDATE.size)
    instructions_at = UPDATE.size + (match_length + 7) // 8 * 8
    if match_length < MATCH_HEADER or instructions_at > len(update):
        raise MalformedPacket(f"flow update of {len(update)} bytes, match of {match_length}")
    match = update[UPDATE.size + MATCH_HEADER : UPDATE.size + match_length]
    in_port, other_fields = _match(match)
    return FlowEntry(priority, match, in_port, other_fields, _output(update[instructions_at:]))


def _match(fields: bytes) -> tuple[int | None, bool]:
    """Return the port that the match asks for, if any, and whether it asks for more."""
    in_port, other_fields, offset = None, False, 0
    while offset < len(fields):
        oxm_class, field, length = OXM.unpack_from(fields, offset)
        offset += OXM.size
        if (oxm_class, field, length) == (ofp.OFPXMC_OPENFLOW_BASIC, IN_PORT, 4):
            (in_port,) = struct.unpack_from("!I", fields, offset)
        else:
            other_fields = True
        offset += length
    return in_port, other_fields


def _output(instructions: bytes) -> int | None:
    """Return the port if the instructions are one output action and nothing else."""
    if len(instructions) != ONE_OUTPUT.size:
        return None
    kind, length, action, action_length, port = ONE_OUTPUT.unpack(instructions)
    if kind not in (ofp.OFPIT_APPLY_ACTIONS, ofp.OFPIT_WRITE_ACTIONS):
        return None
    if (length, action, action_length) != (ONE_OUTPUT.size, ofp.OFPAT_OUTPUT, 16):
        return None
    return int(port)
