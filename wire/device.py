"""Datagrams between the controller and the hosts' node agents: state and settings.

    +--------------------+---------------+-----------+---------------+
    | a metadata message | host name, 32 | number, 8 | HMAC, 16 bytes |
    +--------------------+---------------+-----------+---------------+

controller                       node agent, UDP port DEVICE_PORT
DeviceQuery, Subscribe, SetDevice ->
                              <-  DeviceReport: asked for, or on its own (session 0)
MonitorCommand, PreemptMonitor, SessionQuery ->
                              <-  Answer to SetDevice, to orders and to SessionQuery
                              <-  SessionEstimate, on its own (wire.monitor_messages)

Programs of packages speak by datagrams like these, from ports of their own (`qmn.datagrams`).

The header's session field numbers a request and its answer. The HMAC (SHA-256, cut to 16
bytes) covers everything before it, and who speaks; its key is the device key that the
runner gives to the host and to the controller alone. `number` is the speaker's clock in
nanoseconds, and a listener takes only numbers that rise: what was heard once is no use.
"""

import hmac
import struct
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from functools import cache
from typing import ClassVar

from wire.malformed import MalformedPacket
from wire.metadata.header import HEADER, MAGIC, VERSION, Elements, Message, padded_name
from wire.metadata.setup import Answer
from wire.metadata.vocabulary import FEC_NAMES, Reason
from wire.monitor_messages import MonitorCommand, PreemptMonitor, SessionEstimate
from wire.parameters.checks import check_number
from wire.registered import DATAGRAMS, Registry

DEVICE_PORT = 9012
MAX_DATAGRAM = 1400  # never a fragment: switches do not see the ports of those
MAX_PORTS = 16
PERIODS_S = (0.1, 3600.0)
MAX_SHARE = (0.0, 1.0)
RANGES = {
    "rate_hz": (1, 4_000_000_000),
    "frame_bytes": (1, 1 << 16),
    "fec": (0, 255),
    "interleave": (0, 1),
    "wavelength_pm": (1_000_000, 2_000_000),
    "cutoff_us": (1, (1 << 32) - 2),
    "compensate_s": (1, 1_000_000_000),
}
OF_HOSTS = ("cutoff_us", "compensate_s")
OF_LIGHT = tuple(name for name in RANGES if name not in OF_HOSTS)  # what sessions ask for
NAMED: dict[str, Mapping[str, int]] = {
    "fec": FEC_NAMES,
    "interleave": {"off": 0, "on": 1},
}  # settings people name
TRAILER = struct.Struct("!32sQ")
TAG_BYTES = 16
UNSET = 0xFFFFFFFF
PORT = struct.Struct("!15s?")
MAX_LEVEL_ROUNDS = 8  # of purification, of each span


@dataclass(frozen=True)
class DeviceSettings:
    """Defaults of every session that begins on a host; None leaves them to the application."""

    rate_hz: int | None = None  # pulse rate: pairs a second of the source
    frame_bytes: int | None = None
    fec: int | None = None  # number of the error-correction code; 0 is none
    interleave: int | None = None  # 1: spread its codewords
    wavelength_pm: int | None = None
    cutoff_us: int | None = None  # what its memory has kept for longer is dropped
    compensate_s: int | None = None  # between looks of its polarisation compensator


def check_settings(settings: DeviceSettings) -> None:
    """Raise ValueError naming value and range for a setting out of range."""
    for name, (least, most) in RANGES.items():
        value = getattr(settings, name)
        if value is not None:
            check_number(name, value, least, most)


_SETTINGS = struct.Struct(f"!{len(fields(DeviceSettings))}I")


def setting_number(name: str, value: object) -> int | None:
    """Return a setting as people and programs give it, by name or number; None undoes it.

    Raise ValueError naming value and choices.
    """
    names = NAMED.get(name, {})
    if name == "interleave" and isinstance(value, bool):
        return int(value)
    if isinstance(value, str) and value in names:
        return int(names[value])
    if value is None or (isinstance(value, int) and not isinstance(value, bool)):
        return value
    choices = f"one of {', '.join(names)}, or its number" if names else "a whole number"
    raise ValueError(f"{name} is {value!r}: give {choices}")


def setting_name(name: str, number: int) -> int | str:
    names = {value: text for text, value in NAMED.get(name, {}).items()}
    return names.get(number, number)


def _pack_settings(settings: DeviceSettings) -> bytes:
    values = (getattr(settings, item.name) for item in fields(settings))
    return _SETTINGS.pack(*(UNSET if value is None else value for value in values))


def _unpack_settings(data: bytes) -> DeviceSettings:
    values = (None if value == UNSET else value for value in _SETTINGS.unpack(data))
    settings = DeviceSettings(*values)
    try:
        check_settings(settings)
    except ValueError as error:
        raise MalformedPacket(f"device settings: {error}") from error
    return settings


@dataclass(frozen=True)
class DeviceQuery(Message):
    """Ask for a DeviceReport now."""

    KIND = 32
    FIELDS = struct.Struct("!")


@dataclass(frozen=True)
class Subscribe(Message):
    """Ask for reports without asking: on every change, and when too much is lost or wrong.

    A host that is not asked for longer than a few periods reports by itself, too.
    """

    KIND = 33
    FIELDS = struct.Struct("!III")

    period_ms: int
    lost_ppm: int  # of the pairs since the last report, 1,000,000: never
    symbol_error_ppm: int  # of the symbols received since then


@dataclass(frozen=True)
class SetDevice(Message):
    """Override what the applications of a host ask for, in sessions that begin from now on."""

    KIND = 34
    FIELDS = struct.Struct(f"!{_SETTINGS.size}s")

    settings: DeviceSettings = DeviceSettings()

    def encode(self) -> bytes:
        return self._frame(_pack_settings(self.settings))

    @classmethod
    def parse(cls, session: int, body: bytes) -> "SetDevice":
        if len(body) != cls.FIELDS.size:
            raise MalformedPacket(f"SetDevice: {len(body)} bytes, not {cls.FIELDS.size}")
        return cls(session, _unpack_settings(body))


@dataclass(frozen=True)
class DevicePort:
    name: str  # of its interface, at most 15 bytes
    up: bool


@dataclass(frozen=True)
class DeviceReport(Message):
    """The state of a host. Counts are since its stack started."""

    KIND = 35
    ELEMENTS = Elements("ports", PORT, ("name", "up"), 0, MAX_PORTS)
    FIELDS = struct.Struct(f"!HHHQQQQQQIIIIIIIIQQIIIB{_SETTINGS.size}s")

    sending: int = 0  # sessions that run
    receiving: int = 0
    serving: int = 0  # sessions that this host makes pairs for
    pairs_sent: int = 0
    pairs_made: int = 0
    pairs_received: int = 0
    pairs_lost: int = 0  # of those sent or received by this host
    symbol_errors: int = 0
    repeated_frames: int = 0
    rate_hz: int = 0  # what the session used that began last; 0: there was none
    frame_bytes: int = 0
    fec: int = 0
    interleave: int = 0
    wavelength_pm: int = 0
    period_ms: int = 0  # the subscription in force; 0: none
    lost_ppm: int = 0
    symbol_error_ppm: int = 0
    alarm: int = 0  # the session of this host's last link monitor with an alarm
    monitor: int = 0  # the session of its link monitor that has ended last, with or without alarm
    monitor_compared: int = 0  # pairs in that
    monitor_errors: int = 0  # of these, pairs that differed
    monitor_tests: int = 0  # that found the path whole
    monitor_end: int = 0  # a Reason: OK, BUSY if its light was given back, or why it failed
    settings: DeviceSettings = DeviceSettings()  # the overrides in force
    ports: tuple[DevicePort, ...] = ()

    def encode(self) -> bytes:
        _session, *numbers, settings, ports = vars(self).values()
        fixed = self.FIELDS.pack(*numbers, _pack_settings(settings))
        named = (PORT.pack(port.name.encode(), port.up) for port in ports)
        return self._frame(fixed + b"".join(named))

    @classmethod
    def parse(cls, session: int, body: bytes) -> "DeviceReport":
        size = cls.FIELDS.size
        count, rest = divmod(len(body) - size, PORT.size)
        if len(body) < size or rest or count > MAX_PORTS:
            raise MalformedPacket(f"DeviceReport: {len(body)} bytes do not fit")
        *numbers, settings = cls.FIELDS.unpack_from(body)
        ports = tuple(
            DevicePort(padded_name(name), up) for name, up in PORT.iter_unpack(body[size:])
        )
        report = cls(session, *numbers)
        if report.monitor_end not in set(Reason):
            raise MalformedPacket(f"DeviceReport: a monitor that ended with {report.monitor_end}")
        return replace(report, settings=_unpack_settings(settings), ports=ports)


@dataclass(frozen=True)
class SessionQuery(Message):
    """Ask whether a host takes part in a session: OK, or UNKNOWN_SESSION."""

    KIND = 42
    FIELDS = struct.Struct("!Q")

    about: int  # the session


OWN = (
    DeviceQuery,
    Subscribe,
    SetDevice,
    DeviceReport,
    MonitorCommand,
    PreemptMonitor,
    SessionQuery,
    SessionEstimate,
    Answer,
)


def _is_message(value: object) -> bool:
    return isinstance(value, type) and issubclass(value, Message) and hasattr(value, "KIND")


@cache
def kinds() -> dict[int, type[Message]]:
    """Return the messages of datagrams by number; raise ImportError for a number that is taken."""
    named = Registry[type[Message]](DATAGRAMS, _is_message, {each.__name__: each for each in OWN})
    by_number: dict[int, type[Message]] = {}
    for name, kind in named.items():
        if by_number.setdefault(kind.KIND, kind) is not kind:
            raise ImportError(
                f"{DATAGRAMS}: {name} has the number of {by_number[kind.KIND].__name__}"
            )
    return by_number


@dataclass(frozen=True)
class Datagram:
    """A message, which host it comes from or goes to, and its number."""

    FROM_CONTROLLER: ClassVar[bytes] = b"controller"
    FROM_HOST: ClassVar[bytes] = b"host"

    message: Message
    host: str
    number: int

    def seal(self, key: str, speaker: bytes) -> bytes:
        data = self.message.encode() + TRAILER.pack(self.host.encode(), self.number)
        return data + _tag(key, speaker, data)


def host_of(data: bytes) -> str:
    """Return which host a datagram speaks of, before its HMAC is checked."""
    if not HEADER.size + TRAILER.size + TAG_BYTES <= len(data) <= MAX_DATAGRAM:
        raise MalformedPacket(f"datagram of {len(data)} bytes")
    name, _number = TRAILER.unpack_from(data, len(data) - TAG_BYTES - TRAILER.size)
    return padded_name(name)


def open_sealed(data: bytes, key: str, speaker: bytes) -> Datagram:
    """Read a datagram; raise MalformedPacket unless its speaker knows the key."""
    host = host_of(data)
    signed, tag = data[:-TAG_BYTES], data[-TAG_BYTES:]
    if not hmac.compare_digest(tag, _tag(key, speaker, signed)):
        raise MalformedPacket(f"datagram for {host}: its HMAC is wrong")
    message = signed[: -TRAILER.size]
    _name, number = TRAILER.unpack_from(signed, len(message))
    return Datagram(_decode(message), host, number)


def _tag(key: str, speaker: bytes, data: bytes) -> bytes:
    return hmac.digest(bytes.fromhex(key), speaker + data, "sha256")[:TAG_BYTES]


def _decode(data: bytes) -> Message:
    magic, version, kind, length, session = HEADER.unpack_from(data)
    if (magic, version, length) != (MAGIC, VERSION, len(data)) or kind not in kinds():
        raise MalformedPacket(f"device message: header {data[: HEADER.size].hex()}")
    return kinds()[kind].parse(session, data[HEADER.size :])
