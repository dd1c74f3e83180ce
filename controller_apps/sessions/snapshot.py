"""The state that a controller keeps for its successor: sessions, places of hosts.

Switches keep what counts: bypasses tell which connections of a session live, light entries
which paths it has. They do not hold what a living session needs further on: whom its
set-up named as source, its handshake and wavelength, the rotation its receiver has to
undo, and where on its connection the set-up was. That is kept here, network byte order:

    session: seen (s), requests, paths; each request; each path with its hops
    hosts:   each port: switch, port, address, three lengths, name of host and port, node_features
"""

import struct
from collections.abc import Mapping
from dataclasses import replace
from ipaddress import IPv4Address
from itertools import islice
from socket import inet_aton
from typing import Any

from controller_apps.light.optics import SwitchPort
from controller_apps.light.paths import MAX_PORTS, Hop, HostPort
from controller_apps.light.routing import LightPath
from controller_apps.packets import FiveTuple
from controller_apps.sessions.actions import Keep
from controller_apps.sessions.sessions import Request, Session, read_setup
from wire.features import NodeFeatures
from wire.malformed import MalformedPacket
from wire.metadata.header import METADATA_PORT
from wire.metadata.setup import SETUP_LENGTH, Setup
from wire.metadata.vocabulary import Handshake, Reason, Service, Verdict
from wire.optical import ANY_WAVELENGTH
from wire.outcomes import Pauli
from wire.services import LIGHT, switches_used

MAX_KEPT_REQUESTS = 8  # of one session; it needs two
SESSION = struct.Struct("!dBH")
REQUEST = struct.Struct(f"!4sH4sIBII{SETUP_LENGTH}s")  # to the metadata port
PATH = struct.Struct("!IBB")  # loss in thousandths of a dB, rotation, hops
HOP = struct.Struct("!QII")
HOST = struct.Struct("!QI4sBBB")


def keep(session: Session) -> Keep:
    session.saved = True
    return Keep(session.number, encode_session(session))


def encode_session(session: Session) -> bytes:
    """Return what is to be kept of a session whose owner has been granted.

    Light that comes with each pair is not kept: the next pair asks for it again.
    """
    waiting = (each for each in session.requests.values() if each.held is None and each.lasts)
    requests = list(islice(waiting, MAX_KEPT_REQUESTS))
    paths = session.paths if session.light_owner == session.owner else ()
    data = SESSION.pack(session.seen, len(requests), len(paths))
    for request in requests:
        source, port, destination, _ = request.five_tuple
        data += REQUEST.pack(
            inet_aton(source),
            port,
            inet_aton(destination),
            request.sequence,
            request.rotation,
            request.granted_pairs,
            request.granted_pm,
            request.message,
        )
    for path in paths:
        data += PATH.pack(path.loss_mdb, path.rotation, len(path.hops))
        data += b"".join(HOP.pack(*hop) for hop in path.hops)
    return data


def decode_session(data: bytes, now: float) -> Session:
    """Read a session back; raise MalformedPacket for invalid data.

    Its owner is the first request; `now` is of the clock that it was last seen on.
    """
    reader = _Reader(data)
    seen, requests, paths = reader.take(SESSION)
    if not 0 <= seen <= now:
        raise MalformedPacket(f"a session last seen at {seen} s, when it is {now} s")
    if not 1 <= requests <= MAX_KEPT_REQUESTS:
        raise MalformedPacket(f"a session of {requests} requests")
    owner, *others = (_request(reader, now) for _ in range(requests))
    session = Session(owner.setup.session, owner.setup, owner.five_tuple, seen, open=True)
    session.requests = {owner.five_tuple: owner}
    session.paths = tuple(_path(reader) for _ in range(paths))
    session.light_owner = session.owner if paths else None
    reader.end()
    _check_owner(session)
    for request in others:
        _check_member(request, session)
    session.requests = {request.five_tuple: request for request in (owner, *others)}
    if len(session.requests) != requests:
        raise MalformedPacket("two requests of one connection")
    return session


def _request(reader: "_Reader", now: float) -> Request:
    source, port, destination, sequence, rotation, *granted, message = reader.take(REQUEST)
    pairs, wavelength_pm = granted
    flow = FiveTuple(str(IPv4Address(source)), port, str(IPv4Address(destination)), METADATA_PORT)
    setup = read_setup(message)
    if setup.verdict != Verdict.PENDING or setup.session == 0 or rotation > max(Pauli):
        raise MalformedPacket(f"no set-up of a session with rotation {rotation}: {setup}")
    if not 0 < pairs <= setup.pairs:
        raise MalformedPacket(f"{pairs} pairs granted of {setup.pairs}")
    request = Request(setup, None, flow, sequence, message, now, b"", rotation)
    if setup.wavelength_pm not in (ANY_WAVELENGTH, wavelength_pm):
        raise MalformedPacket(f"{wavelength_pm} pm granted of {setup.wavelength_pm}")
    request.block_pairs, request.wavelength_pm = pairs, wavelength_pm
    answer = replace(request.granted, verdict=Verdict.GRANTED, rotation=rotation, reason=Reason.OK)
    request.answer = answer.encode()
    return request


def _path(reader: "_Reader") -> LightPath:
    loss_mdb, rotation, count = reader.take(PATH)
    if not count or rotation > max(Pauli):
        raise MalformedPacket(f"a path of {count} hops and rotation {rotation}")
    return LightPath(tuple(Hop(*reader.take(HOP)) for _ in range(count)), loss_mdb, rotation)


def _check_owner(session: Session) -> None:
    setup = session.setup
    has_light = switches_used(setup) > 0 or bool(LIGHT.get(Service(setup.service)))
    lit = setup.handshake == Handshake.FRAMED and has_light
    is_owner = setup.handshake in (Handshake.FRAMED, Handshake.PER_PAIR)
    if setup.service not in LIGHT or not is_owner or lit != bool(session.paths):
        raise MalformedPacket(f"{len(session.paths)} paths for a session opened by {setup}")
    try:
        _ = session.frequency_mhz
    except ValueError as error:
        raise MalformedPacket(str(error)) from error


def _check_member(request: Request, session: Session) -> None:
    setup: Setup = request.setup
    ends = request.five_tuple.source, request.five_tuple.destination
    belongs = setup.service == Service.PAIR_SOURCE and setup.session == session.number
    if not belongs or ends != (session.owner.source, session.setup.source):
        raise MalformedPacket(f"{setup} does not belong to session {session.number:016x}")


def encode_hosts(hosts: Mapping[SwitchPort, HostPort]) -> bytes:
    data = b""
    for at, host in hosts.items():
        names = host.host.encode(), host.name.encode()
        address = IPv4Address(host.address).packed
        features = host.node_features.encode() if host.node_features else b""
        texts = *names, features
        data += HOST.pack(*at, address, *map(len, texts)) + b"".join(texts)
    return data


def decode_hosts(data: bytes) -> dict[SwitchPort, HostPort]:
    """Read the places of hosts back; raise MalformedPacket for invalid data."""
    reader = _Reader(data)
    hosts: dict[SwitchPort, HostPort] = {}
    while reader.left and len(hosts) < MAX_PORTS:
        dpid, port, address, host_length, name_length, features_length = reader.take(HOST)
        host, name = reader.text(host_length), reader.text(name_length)
        features = NodeFeatures.decode(reader.raw(features_length)) if features_length else None
        hosts[SwitchPort(dpid, port)] = HostPort(host, str(IPv4Address(address)), name, features)
    reader.end()
    return hosts


class _Reader:
    """Takes structures off the front of bytes; raises MalformedPacket where there are none."""

    def __init__(self, data: bytes) -> None:
        self._data = data
        self._at = 0

    @property
    def left(self) -> int:
        return len(self._data) - self._at

    def take(self, form: struct.Struct) -> tuple[Any, ...]:
        if self.left < form.size:
            raise MalformedPacket(f"{len(self._data)} bytes end within a structure")
        self._at += form.size
        return form.unpack_from(self._data, self._at - form.size)

    def raw(self, length: int) -> bytes:
        (data,) = self.take(struct.Struct(f"!{length}s"))
        return bytes(data)

    def text(self, length: int) -> str:
        try:
            return str(self.raw(length), "utf-8")
        except UnicodeDecodeError as error:
            raise MalformedPacket(f"a name is not UTF-8: {error}") from error

    def end(self) -> None:
        if self.left:
            raise MalformedPacket(f"{self.left} bytes behind the last structure")
