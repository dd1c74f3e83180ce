"""The arbiter's orders; the app turns each into OpenFlow or a line of text."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from controller_apps.light.optics import SwitchPort
from controller_apps.light.paths import Hop
from controller_apps.packets import FiveTuple
from controller_apps.sessions.holders import Ends, Holder
from controller_apps.sessions.sessions import Request
from wire.analyser_frames import AnalyserFrame, Emission, Receivers
from wire.device import SessionQuery
from wire.monitor_messages import MonitorCommand, PreemptMonitor

HostCommand = MonitorCommand | PreemptMonitor | SessionQuery


@dataclass(frozen=True)
class Forward:
    """Send a frame on from the classical switch that punted it."""

    dpid: int
    in_port: int
    frame: bytes


@dataclass(frozen=True)
class OpenPaths:
    """Program the hops of one quantum switch in one bundle, then ask for a barrier.

    In this order: hops of the session that it no longer takes are closed, ports are tuned,
    hops are opened.
    """

    dpid: int
    hops: tuple[Hop, ...]
    session: int
    transaction: int  # to be given back with the barrier reply or the error
    closed: tuple[Hop, ...] = ()
    tuned: tuple[int, ...] = ()  # ports
    frequency_mhz: int = 0  # to which they are tuned
    reports: bool = False  # the controller hears of outcomes, too
    heard: Mapping[int, Receivers] = field(default_factory=dict)  # of heralds, by memory
    place: int = 0  # of its analyser in a chain, of which outcomes tell


@dataclass(frozen=True)
class Emit:
    """Have a pair source of a quantum switch, by one of its ports, make a block."""

    dpid: int
    port: int
    emission: Emission


@dataclass(frozen=True)
class KeepPulses:
    """Have a memory discard or purify pulses of a block, as a frame says."""

    dpid: int
    port: int
    herald: AnalyserFrame


@dataclass(frozen=True)
class Flood:
    """Send a frame to all stations behind a classical switch."""

    dpid: int
    frame: bytes


@dataclass(frozen=True)
class ClosePaths:
    """Delete every path of a session from one quantum switch."""

    dpid: int
    session: int


@dataclass(frozen=True)
class AddBypass:
    """Let a connection pass a classical switch without the controller."""

    dpid: int
    five_tuple: FiveTuple
    session: int


@dataclass(frozen=True)
class RemoveBypass:
    dpid: int
    five_tuple: FiveTuple
    session: int


@dataclass(frozen=True)
class CountBypass:
    """Ask how many bytes of a connection have passed a classical switch by its bypass."""

    dpid: int
    five_tuple: FiveTuple
    session: int


@dataclass(frozen=True)
class Keep:
    """Keep a session for the controller that may come after this one."""

    session: int
    data: bytes


@dataclass(frozen=True)
class Forget:
    """Keep nothing of a session any more."""

    session: int


@dataclass(frozen=True)
class Command:
    """Tell or ask a host's node agent something, until it has answered."""

    node: str  # address
    message: HostCommand  # without the number of the request


@dataclass(frozen=True)
class Note:
    """A fact for the log and the record."""

    event: str
    session: int
    setup_ms: float | None = None
    detail: str = ""
    at: SwitchPort | None = None  # where the set-up that it is about has come, if it is about one
    ends: Ends = ("", "")  # of a session that has waited for light: its opener and its acceptor
    after: Holder | None = None  # who had the last of that light until now
    asked: Request | None = field(default=None, compare=False)  # the request that it answers


@dataclass(frozen=True)
class Drop:
    """A frame that goes no further."""

    cause: str  # under which it is counted
    detail: str
    at: SwitchPort  # where it arrived


Programming = OpenPaths | Emit | KeepPulses | ClosePaths
SwitchAction = Forward | Flood | Programming | AddBypass | RemoveBypass | CountBypass
Action = SwitchAction | Keep | Forget | Command | Note | Drop
