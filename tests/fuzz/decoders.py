"""Every decoder of bytes that come from elsewhere, with messages that are right.

Those of wire/ and of formats of applications/ are here, or excused; those that a program has for
itself are in `of_programs`.
"""

import asyncio
import io
import json
from dataclasses import replace
from random import Random
from typing import Any
from uuid import UUID

import netqasm_samples
import numpy as np
import of_programs
import test_device_messages
import test_metadata
import test_packed_folder
import test_pcapng
import test_qkd
from scapy.layers.inet6 import IPv6, IPv6ExtHdrFragment, IPv6ExtHdrHopByHop
from spoiling import spoiled, spoiled_json
from target import Target

from applications.ip_over_light import ip_packet
from applications.ip_over_light.lost_packet import Packet
from applications.key_distribution.under_way import Cutter
from applications.keys import key_assignment, key_delivery, key_relay
from applications.keys.route_messages import Hop, KeyLinks, LinkState
from applications.netqasm import text_format
from applications.processing_unit import messages, pair_requests, subroutine
from applications.qkd import messages as qkd
from applications.qkd.conference_proposal import ConferenceProposal
from controller_apps import packets
from controller_apps.openflow import discovery
from wire import (
    controller_lines,
    device,
    dispatcher_record,
    dispatcher_service,
    events,
    gaps,
    machine_channel,
    optical,
    packed_folder,
    pcapng,
    record_pb2,
    socket_calls,
    verdict,
)
from wire import lldp as host_seal
from wire.analyser_frames import (
    BROADCAST,
    AnalyserFrame,
    Emission,
    End,
)
from wire.dispatcher_pb2 import BlockId, Event
from wire.features import EVERYTHING, NodeFeatures
from wire.lldp import announcement
from wire.malformed import MalformedPacket
from wire.metadata.decoding import decode
from wire.metadata.vocabulary import Verdict
from wire.results import time_series

KEY = "0f" * 16
CONNECTION = ("10.0.0.1", 4711, "10.0.0.2", 9010)
IDS = [UUID(int=number) for number in (1, 2, 3)]


def _golden(pairs: Any) -> list[bytes]:
    every = pairs.items() if isinstance(pairs, dict) else pairs
    return [bytes.fromhex(golden.replace(" ", "")) for _message, golden in every]


def _sealed(data: bytes, random: Random) -> bytes:
    """Spoil a datagram and seal it again, as a host of bad intent can."""
    changed = spoiled(data, random)
    return changed + device._tag(KEY, device.Datagram.FROM_HOST, changed)


def _open(data: bytes) -> device.Datagram:
    return device.open_sealed(data, KEY, device.Datagram.FROM_HOST)


def _entries(data: bytes) -> list[record_pb2.Entry]:
    return list(dispatcher_record.read(io.BytesIO(data)))


def _packets(data: bytes) -> list[pcapng.Packet]:
    return list(pcapng.Reader(io.BytesIO(data)).packets())


def _pcap_packets(data: bytes) -> list[pcapng.Packet]:
    return list(pcapng.PcapReader(io.BytesIO(data)).packets())


def _query(data: bytes) -> dict[str, list[bytes]]:
    """Return what a web server makes of the query of a request."""
    pairs = [each.partition(b"=") for each in data.split(b"&")]
    found: dict[str, list[bytes]] = {}
    for name, _, value in pairs:
        found.setdefault(name.decode("latin-1"), []).append(value)
    return found


def _frame(data: bytes) -> bytes:
    async def read() -> bytes:
        stream = asyncio.StreamReader()
        stream.feed_data(data)
        stream.feed_eof()
        return await dispatcher_service.read(stream)

    return asyncio.run(read())


def _packet(data: bytes) -> Packet:
    packet = ip_packet.decode(data, MOST_IP_BYTES)
    # Whatever comes in pieces, and more than one behind the other, is cut as one that comes whole.
    stream = ip_packet.PacketStream(MOST_IP_BYTES)
    found = [each for byte in data + data for each in stream.feed(bytes((byte,)))]
    assert found == [packet, packet], found
    assert 0 < packet.header_bytes <= len(data) + MOST_EXTENSION, packet
    return packet


def _of_machine(data: bytes) -> tuple[dict[str, Any], bytes]:
    async def read() -> tuple[dict[str, Any], bytes]:
        stream = asyncio.StreamReader()
        stream.feed_data(data)
        stream.feed_eof()
        message = await machine_channel.receive(stream)
        if message is None:
            raise MalformedPacket("no whole message")
        return message

    return asyncio.run(read())


def _call(data: bytes) -> tuple[socket_calls.Call, int]:
    return socket_calls.decode_header(data[:5].ljust(5, b"\0"))


def _genuine(data: bytes) -> bytes:
    if not verdict.is_sealed(data, KEY, CONNECTION):
        raise MalformedPacket("not the controller's")
    return data


def _cut(data: bytes) -> list[bytes]:
    return list(Cutter().feed(data))


def _text(data: bytes) -> str | None:
    return text_format.take_text(bytearray(data))


def _written_record() -> bytes:
    file = io.BytesIO()
    dispatcher_record.begin(file)
    dispatcher_record.write(file, record_pb2.Entry(header=record_pb2.Header()))
    return file.getvalue()


def _key_texts(*values: Any) -> list[bytes]:
    return [json.dumps(value).encode() for value in values]


SEGMENT = bytes(
    netqasm_samples.Ether(src="02:00:00:00:00:01", dst="02:00:00:00:00:02")
    / netqasm_samples.IP(src=CONNECTION[0], dst=CONNECTION[2])
    / netqasm_samples.TCP(sport=4711, dport=9010)
    / b"payload"
)
MOST_IP_BYTES, MOST_EXTENSION = 1500, 8 * 256
IP_PACKETS = [
    bytes(netqasm_samples.IP(src="10.1.0.1", dst="10.1.0.2") / netqasm_samples.TCP() / b"data"),
    bytes(netqasm_samples.IP(dst="10.1.0.2", options=b"\1" * 4, frag=9) / b"fragment"),
    bytes(netqasm_samples.IP(dst="10.1.0.2", proto=1) / b"\3\1\0\0"),
    bytes(IPv6(dst="fd71::2") / IPv6ExtHdrHopByHop() / IPv6ExtHdrFragment() / b"fragment"),
    bytes(IPv6(dst="fd71::2") / netqasm_samples.TCP() / b"data"),
]
PROPOSAL = ConferenceProposal(5, qkd.Bound.FINITE, 1e-10, 1e-15, ("alice", "bob"))
VERDICT = verdict.seal(test_metadata.SETUP.encode(), KEY, CONNECTION)
LLDP = announcement(
    "alice", "alice-q0", "10.0.0.1", b"\2" * 6, 3, NodeFeatures(EVERYTHING, 9), KEY, 7
)
KEYS = key_delivery.encode_keys([key_delivery.DeliveredKey(each, b"k" * 32) for each in IDS])
ASSIGNMENT = key_assignment.Assignment(
    "sae-alice",
    ("sae-bob",),
    (
        key_assignment.AssignedKey(IDS[0], 256, (IDS[1],)),
        key_assignment.AssignedKey(IDS[2], 8, (), b"k"),
    ),
)
RELAY = key_relay.Relay(
    "sae-alice",
    ("sae-bob",),
    5,
    (Hop("10.0.0.1"), Hop("10.0.0.2", b"t" * 16)),
    ((IDS[0], 16),),
    IDS[1],
    (IDS[2],),
    b"mm",
)
EVENT = Event(time_ns=5, node="bob", kind="receive", block=BlockId(session=7), photons=9)
JUDGED = [replace(test_metadata.SETUP, verdict=each).encode() for each in Verdict]
KEY_LINKS = KeyLinks(
    0, (LinkState("10.0.0.2", 9, 8, 64, 4096, 12_300), LinkState("10.0.0.3", 0, 0, 64, 0))
)
DATAGRAMS = [
    device.Datagram(message, "alice", 9).seal(KEY, device.Datagram.FROM_HOST)[: -device.TAG_BYTES]
    for message in (*test_device_messages.GOLDEN, KEY_LINKS)
]
PROPERTIES: dict[str, tuple[type[optical.OpticalProperty], int]] = {
    "optical port description": (optical.PortOptics, 9),
    "optical PORT_MOD": (optical.PortTuning, 5),
    "optical port statistics": (optical.PortLight, 11),
}

FORMATS: dict[str, Target] = {
    "metadata": Target([*_golden(test_metadata.GOLDEN), *JUDGED], decode, lambda m: m.encode()),
    "key distribution": Target(
        [test_qkd.whole(message) for message, _golden in test_qkd.GOLDEN],
        lambda data: (sealed := qkd.unframe(data), sealed.open()),
        lambda both: qkd.unsealed(both[1], both[0].session, both[0].sequence) + both[0].tag,
    ),
    "key distribution, cut": Target(
        [b"".join(test_qkd.whole(message) for message, _golden in test_qkd.GOLDEN)],
        _cut,
        b"".join,
        canonical=False,  # what is not whole yet waits
    ),
    "device": Target(
        DATAGRAMS,
        _open,
        lambda d: d.seal(KEY, device.Datagram.FROM_HOST),
        spoil=_sealed,
        canonical=False,  # names are padded
    ),
    "device, sealed": Target(
        [data + device._tag(KEY, device.Datagram.FROM_HOST, data) for data in DATAGRAMS],
        _open,
        lambda d: d.seal(KEY, device.Datagram.FROM_HOST),
        canonical=False,
    ),
    "device, of another": Target(
        [data + bytes(device.TAG_BYTES) for data in DATAGRAMS], _open, lambda _d: b"forged"
    ),
    "seal of a fibre": Target(
        [host_seal.seal(b"tlvs", KEY, 9)],
        lambda data: host_seal.open_seal(data, b"tlvs", KEY),
        lambda number: host_seal.seal(b"tlvs", KEY, number),
    ),
    "conference proposal": Target(
        [PROPOSAL.encode()], ConferenceProposal.decode, lambda proposal: proposal.encode()
    ),
    "verdict": Target([VERDICT], _genuine, lambda _genuine: VERDICT),
    "LLDP": Target([LLDP], discovery.parse),
    "features": Target(
        [NodeFeatures(EVERYTHING, 9).encode()], NodeFeatures.decode, lambda a: a.encode()
    ),
    "segment": Target([SEGMENT], packets.parse_segment, lambda s: s.frame),
    "segment, rewritten": Target(
        [SEGMENT],
        packets.parse_segment,
        lambda s: s.with_payload(s.payload),
        canonical=False,  # checksums, and padding
        means=lambda s: (s.five_tuple, s.sequence, s.flags, s.payload, s.after),
    ),
    "datagram": Target([test_pcapng.FRAME], packets.Frame.decode, lambda f: f.encode(), False),
    "analyser frame": Target(
        [
            AnalyserFrame(60_001, 7, End.MEASURED, 5, 1, b"\0\1\xff").encode(BROADCAST, bytes(6)),
            AnalyserFrame(60_001, 7, End.CLOSED, 5).encode(BROADCAST, bytes(6)),
        ],
        AnalyserFrame.decode,
        lambda frame: frame.encode(BROADCAST, bytes(6)),
        canonical=False,  # addresses
    ),
    "emission": Target(
        [Emission(7, 3, 100, 50_000_000, 193_400_000).encode()],
        Emission.decode,
        lambda emission: emission.encode(),
        canonical=False,  # addresses
    ),
    "gaps": Target(
        [gaps.encode(np.array(each)) for each in ([0], [0, 3, 9, 10], [7, 500, 999])],
        lambda data: gaps.decode(data, 1000),
        gaps.encode,
        canonical=False,  # any shift says it
        refusals=(ValueError,),
        means=lambda positions: positions.tolist(),
    ),
    "path optics": Target(
        [optical.PathOptics(1, 2, 1500, 3, True).encode() * 3],
        optical.decode_path_optics,
        optical.encode_path_optics,
        canonical=False,  # padding
    ),
    "event": Target(
        [events.encode_record(EVENT)], events.decode_record, events.encode_record, canonical=False
    ),
    "event, shown": Target(
        [events.encode_record(EVENT)],
        lambda data: (
            events.format_line(event := events.decode_record(data))
            + json.dumps(events.to_json(event))
        ),
    ),
    "record": Target([_written_record()], _entries, refusals=(dispatcher_record.BadRecord,)),
    "IP packet": Target(IP_PACKETS, _packet, lambda packet: packet.data),
    "machine": Target(
        [machine_channel.encode({"do": "start", "names": ["q1"]}, b"body")],
        _of_machine,
        lambda message: machine_channel.encode(*message),
        canonical=False,  # JSON, and what comes behind
    ),
    "packed folder": Target(
        [test_packed_folder.GOLDEN], packed_folder.decode, packed_folder.encode
    ),
    "line of an application": Target(
        _key_texts({"event": "key", "key_ID": str(IDS[0]), "seconds": 0.5}),
        time_series.fields_of,
        lambda fields: json.dumps(fields).encode(),
        False,
        spoiled_json,
        refusals=(),
    ),
    "pcapng": Target([test_pcapng.written()], _packets),
    "pcap": Target([netqasm_samples.pcap(SEGMENT)], _pcap_packets),
    "frame": Target(
        [dispatcher_service.encode(b"message")],
        _frame,
        dispatcher_service.encode,
        False,
        refusals=(MalformedPacket, EOFError),
    ),
    "socket call": Target([socket_calls.encode(call, b"") for call in socket_calls.Call], _call),
    "socket call's fields": Target(
        _key_texts({"service": "sdc", "host": "bob", "options": {"port": 7}}),
        socket_calls.decode_fields,
        lambda fields: json.dumps(fields).encode(),
        False,
        spoiled_json,
    ),
    "console": Target(
        [controller_lines.encode_request("set", device="alice", settings={"rate_hz": 1})],
        controller_lines.decode_request,
        spoil=lambda data, random: spoiled_json(data, random) + b"\n",
    ),
    "console's answer": Target(
        [controller_lines.encode_result([1]), controller_lines.encode_error("no")],
        controller_lines.decode_answer,
        spoil=spoiled_json,
        refusals=(MalformedPacket, controller_lines.ConsoleError),
    ),
    "request for keys": Target(
        _key_texts(
            {"number": 3, "size": 256, "additional_slave_SAE_IDs": ["sae-a", "sae-b"]},
            {"extension_mandatory": [{"a": 1}], "extension_optional": [{"b": None}]},
        ),
        key_delivery.decode_request,
        spoil=spoiled_json,
    ),
    "ids of keys": Target(
        _key_texts({"key_IDs": [{"key_ID": str(each)} for each in IDS]}),
        key_delivery.decode_key_ids,
        spoil=spoiled_json,
    ),
    "container of keys": Target(
        [KEYS], key_delivery.decode_keys, key_delivery.encode_keys, False, spoiled_json
    ),
    "refusal of keys": Target(
        [key_delivery.encode_refusal("no", [{"a": "b"}])],
        key_delivery.decode_refusal,
        key_delivery.encode_refusal,
        False,
        spoiled_json,
    ),
    "query for keys": Target(
        [b"number=3&size=64"], lambda data: key_delivery.decode_query(_query(data))
    ),
    "query by id": Target(
        [b"key_ID=" + str(IDS[0]).encode()],
        lambda data: key_delivery.decode_id_query(_query(data)),
    ),
    "assignment of keys": Target(
        [ASSIGNMENT.encode()],
        key_assignment.Assignment.decode,
        lambda a: a.encode(),
        False,
        spoiled_json,
    ),
    "relay of keys": Target(
        [RELAY.encode()], key_relay.Relay.decode, lambda r: r.encode(), False, spoiled_json
    ),
    "relay of keys, sealed": Target(
        [key_relay.encode_sealed(RELAY.encode(), b"t" * 16)],
        key_relay.decode_sealed,
        lambda both: key_relay.encode_sealed(*both),
        False,
        spoiled_json,
    ),
    "NetQASM, application": Target(netqasm_samples.HOST_MESSAGES, messages.decode_host_message),
    "NetQASM, unit": Target(
        netqasm_samples.UNIT_MESSAGES,
        messages.decode_unit_message,
        messages.encode_unit_message,
        canonical=False,  # padding, and values of entries that are not defined
    ),
    "NetQASM, subroutine": Target(netqasm_samples.SUBROUTINES, subroutine.decode_subroutine),
    "NetQASM, greeting": Target(
        [text_format.encode_greeting(text_format.Greeting("alice", "bob", 3))],
        text_format.decode_greeting,
        text_format.encode_greeting,
    ),
    "NetQASM, text": Target([text_format.encode_text("später")], _text),
    "NetQASM, pairs wanted": Target(
        [netqasm_samples.PAIRS.encode()],
        pair_requests.decode_request,
        lambda r: r.encode(),
    ),
    "NetQASM, pairs granted": Target(
        [pair_requests.PairAnswer(pair_requests.Verdict.READY, 7, 9).encode()],
        pair_requests.decode_answer,
        lambda a: a.encode(),
    ),
    "NetQASM, pairs made": Target(
        [pair_requests.PairsMade(7).encode()], pair_requests.decode_made, lambda m: m.encode()
    ),
} | {
    name: Target(
        [kind(*range(1, count + 1)).encode()], kind.decode, lambda p: p.encode(), canonical=False
    )
    for name, (kind, count) in PROPERTIES.items()
}
TARGETS = FORMATS | of_programs.TARGETS

EXCUSED = {  # what decodes or parses in wire/ and is not fed, and why
    "wire.results.schema.decoded": "a file, spoiled in tests/unit/views/test_runs.py",
}
