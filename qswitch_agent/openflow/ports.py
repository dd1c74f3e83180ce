"""Ports as bytes: descriptions, states, statistics, PORT_MOD."""

import os
import struct
from collections.abc import Iterator
from dataclasses import dataclass, replace

from qswitch_agent.openflow import constants as ofp
from qswitch_agent.openflow import messages
from qswitch_agent.openflow.messages import (
    HEADER,
    NOT_AVAILABLE,
    PART,
    MalformedPart,
    encode,
    strict,
    with_body,
)
from wire.analyser_frames import CUT_OFF, CUT_OFF_HEAD
from wire.malformed import MalformedPacket
from wire.optical import OPTICAL, PortTuning

PORT = struct.Struct(ofp.OFP_PORT_PACK_STR)  # number, length, address, name, config, state
STATISTICS = struct.Struct(ofp.OFP_PORT_STATS_PACK_STR)
STATUS_PORT = ofp.OFP_PORT_STATUS_DESC_OFFSET
MOD = struct.Struct(ofp.OFP_PORT_MOD_PACK_STR)  # number, address, config, mask
REASONS = 1 << ofp.OFPPR_ADD | 1 << ofp.OFPPR_DELETE | 1 << ofp.OFPPR_MODIFY
PROPERTY_HEADER = 4


@dataclass(frozen=True)
class Port:
    """The description of a port (ofp_port)."""

    number: int
    address: bytes
    name: str
    config: int  # OFPPC_ bits
    state: int  # OFPPS_ bits
    properties: bytes
    gone: bool = False  # it does not exist any more

    @property
    def up(self) -> bool:
        down = self.config & ofp.OFPPC_PORT_DOWN or self.state & ofp.OFPPS_LINK_DOWN
        return not (down or self.gone)

    def encode(self) -> bytes:
        length, name = PORT.size + len(self.properties), os.fsencode(self.name)
        fixed = PORT.pack(self.number, length, self.address, name, self.config, self.state)
        return fixed + self.properties


@strict
def _ports(data: bytes) -> Iterator[Port]:
    offset = 0
    while offset < len(data):
        number, length, address, name, config, state = PORT.unpack_from(data, offset)
        if not PORT.size <= length <= len(data) - offset:
            raise MalformedPacket(f"description of port {number} with length {length}")
        properties = data[offset + PORT.size : offset + length]
        text = os.fsdecode(name.partition(b"\0")[0])
        yield Port(number, address, text, config, state, properties)
        offset += length


@strict
def described_ports(message: bytes) -> list[Port]:
    status = message[1] == ofp.OFPT_PORT_STATUS
    return list(_ports(message[STATUS_PORT if status else messages.BODY :]))


@strict
def status_reason(message: bytes) -> int:
    return message[HEADER.size]


@strict
def with_ports(message: bytes, ports: list[Port]) -> bytes:
    parts = [port.encode() for port in ports]
    if message[1] == ofp.OFPT_PORT_STATUS:
        return with_body(message, message[HEADER.size : STATUS_PORT] + b"".join(parts))
    return messages.rebuilt(message, parts)


def port_watch(xid: int) -> bytes:
    """Return requests for the state of every port as it is and for each change of it.

    The agent's role on its own connection is EQUAL, for which the master's settings hold.
    """
    reasons = struct.pack(
        ofp.OFP_ASYNC_CONFIG_PROP_REASONS_PACK_STR,
        ofp.OFPACPT_PORT_STATUS_MASTER,
        ofp.OFP_ASYNC_CONFIG_PROP_REASONS_SIZE,
        REASONS,
    )
    return encode(ofp.OFPT_SET_ASYNC, xid, reasons) + messages.request(ofp.OFPMP_PORT_DESC, xid)


@dataclass(frozen=True)
class PortMod:
    """A PORT_MOD; the optical property and a memory's cut-off apart from the others."""

    number: int
    address: bytes
    config: int
    mask: int
    properties: bytes = b""
    tuning: PortTuning | None = None
    cutoff_s: float | None = None

    @classmethod
    @strict
    def decode(cls, message: bytes) -> "PortMod":
        number, address, config, mask = MOD.unpack_from(message, HEADER.size)
        others, tunings, cutoff_s = b"", [], None
        for kind, body in _properties(message[HEADER.size + MOD.size :]):
            if kind == OPTICAL:
                tunings.append(_tuning(body))
            elif body.startswith(CUT_OFF_HEAD):
                cutoff_s = CUT_OFF.unpack_from(body)[-1] / 1e9
            else:
                others += body
        if len(tunings) > 1:
            reason = f"PORT_MOD with {len(tunings)} optical properties"
            raise MalformedPart(ofp.OFPET_BAD_PROPERTY, ofp.OFPBPC_DUP_TYPE, reason)
        tuning = tunings[0] if tunings else None
        return PortMod(number, address, config, mask, others, tuning, cutoff_s)

    def encode(self, xid: int) -> bytes:
        """Return the message without these properties, as the bridge understands it."""
        fixed = MOD.pack(self.number, self.address, self.config, self.mask)
        return encode(ofp.OFPT_PORT_MOD, xid, fixed + self.properties)


def _tuning(body: bytes) -> PortTuning:
    length = int.from_bytes(body[2:4], "big")
    if length != PortTuning.LENGTH:
        raise _bad_length(length)
    return PortTuning.decode(body)


def _bad_length(length: int) -> MalformedPart:
    reason = f"port property with length {length}"
    return MalformedPart(ofp.OFPET_BAD_PROPERTY, ofp.OFPBPC_BAD_LEN, reason)


def _properties(data: bytes) -> Iterator[tuple[int, bytes]]:
    """Yield type and bytes, padding included, of each property."""
    offset = 0
    while offset < len(data):
        kind, length = PART.unpack_from(data.ljust(offset + PART.size, b"\0"), offset)
        padded = length + -length % 8
        if not PROPERTY_HEADER <= length <= padded <= len(data) - offset:
            raise _bad_length(length)
        yield kind, data[offset : offset + padded]
        offset += padded


@dataclass(frozen=True)
class PortStatistics:
    """One port in a reply to OFPMP_PORT_STATS."""

    fixed: tuple[int, ...]  # as in STATISTICS
    properties: bytes

    @property
    def number(self) -> int:
        return self.fixed[1]

    def encode(self) -> bytes:
        length = STATISTICS.size + len(self.properties)
        return STATISTICS.pack(length, *self.fixed[1:]) + self.properties

    def shown(self, photons: tuple[int, int, int], light: bytes) -> "PortStatistics":
        """Return what a controller sees of a fibre port: photons in, out and lost, and light.

        Photons in and out are its packets, those lost its dropped packets. There are no
        other counters: light has no bytes, and errors are for receivers to see.
        """
        came, went, lost = photons
        none = NOT_AVAILABLE
        counters = came, went, none, none, lost, none, none, none
        return replace(self, fixed=(*self.fixed[:4], *counters), properties=light)


@strict
def port_statistics(message: bytes) -> list[PortStatistics]:
    ports, offset = [], messages.BODY
    while offset < len(message):
        fixed = STATISTICS.unpack_from(message, offset)
        if not STATISTICS.size <= fixed[0] <= len(message) - offset:
            raise MalformedPacket(f"port statistics with length {fixed[0]}")
        ports.append(PortStatistics(fixed, message[offset + STATISTICS.size : offset + fixed[0]]))
        offset += fixed[0]
    return ports
