"""Copies of set-up messages, which quantum switches have got on copper and handed up.

A request is as a switch has seen it if connection and message are the same. A copy may come before
the message itself, or after light is granted.
"""

from dataclasses import dataclass, field

from controller_apps.light.optics import SwitchPort
from controller_apps.light.paths import switches
from controller_apps.packets import FiveTuple, parse_segment
from controller_apps.sessions.actions import Action, Note
from controller_apps.sessions.light_paths import Light
from controller_apps.sessions.sessions import Request, Sessions, read_setup
from wire.malformed import MalformedPacket
from wire.metadata.setup import SETUP_LENGTH

MAX_EARLY = 1024  # messages

Early = dict[tuple[FiveTuple, bytes], dict[int, float]]


@dataclass
class Copies:
    """Those of requests, and the latest that came before theirs."""

    sessions: Sessions
    light: Light
    _early: Early = field(default_factory=dict)  # when, by datapath id

    def arrived(self, at: SwitchPort, frame: bytes, now: float) -> list[Action]:
        """Note a copy; raise MalformedPacket for what is none, on a connection without a set-up."""
        segment = parse_segment(frame)
        connection, message = segment.five_tuple, segment.payload[:SETUP_LENGTH]
        request = self.sessions.requests.get(connection)
        if request is not None and request.message == message:
            return self._seen(request, at, now)
        try:
            read_setup(message)
        except MalformedPacket:
            if request is not None:
                return []  # data behind it
            raise
        self._early.setdefault((connection, message), {}).setdefault(at.dpid, now)
        if len(self._early) > MAX_EARLY:
            del self._early[next(iter(self._early))]
        return []

    def asked(self, request: Request) -> None:
        """Add the copies that came before a request."""
        early = self._early.pop((request.five_tuple, request.message), {})
        for dpid, moment in early.items():
            request.seen.setdefault(dpid, moment)

    def _seen(self, request: Request, at: SwitchPort, now: float) -> list[Action]:
        if at.dpid in request.seen:
            return []
        request.seen[at.dpid] = now
        session = self.sessions.of(request)
        if session is None or session.light_owner != request.five_tuple:
            return []
        if request.held is None and at.dpid in switches(session.hops):
            return [Note("copy_late", session.number, (now - request.started) * 1000, at=at)]
        if at.dpid not in request.unseen:
            return []
        request.unseen.discard(at.dpid)
        return [] if request.unseen else self.light.program(request, session)
