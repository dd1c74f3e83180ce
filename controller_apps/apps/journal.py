"""The journal of the quantum-metadata app: facts for the record, lines for the log."""

from collections import Counter
from collections.abc import Callable
from logging import WARNING, Logger
from math import inf
from typing import Any

from controller_apps.console.views import light_view, name_of, request_view
from controller_apps.devices.hosts_state import Place
from controller_apps.light.paths import Network, switches
from controller_apps.packets import FiveTuple, is_management, is_without_data
from controller_apps.record import PortLines, Record
from controller_apps.sessions.actions import Drop, Note
from controller_apps.sessions.link_monitors import Links, names_of
from controller_apps.sessions.sessions import Session, Sessions
from wire.device import DeviceReport
from wire.metadata.setup import Setup
from wire.metadata.vocabulary import Reason, Service
from wire.monitor_messages import Quantity, SessionEstimate
from wire.network_time import REAL_TIME, NetworkTime


class Journal:
    def __init__(
        self,
        record: Record,
        network: Network,
        sessions: Sessions,
        logger: Logger,
        clock: Callable[[], float],
        time: NetworkTime = REAL_TIME,
    ) -> None:
        """`clock` returns seconds of the wall, by which lines of the log are bounded."""
        self._time = time
        self._record, self._network, self._sessions = record, network, sessions
        self._lines, self._logger, self._clock = PortLines(logger), logger, clock
        self.packet_ins = 0
        self.packet_in_count = 0  # of these, of what runs in the network
        self.copied = False  # whether quantum switches get copies of set-up messages
        self.dropped: Counter[str] = Counter()  # by cause

    def packet_came(self, frame: bytes) -> None:
        """Count a packet; apart, what sessions and hosts send once time has begun.

        How many segments without data there are, and announcements and reports, follows the wall.
        """
        self.packet_ins += 1
        follows_wall = is_management(frame) or is_without_data(frame)
        self.packet_in_count += self._time.has_begun and not follows_wall

    def time_passed(self) -> None:
        self._lines.time_passed(self._clock())

    def close(self) -> None:
        self._lines.time_passed(inf)
        self._record.write("stopped", packet_in_count=self.packet_in_count)

    def switch_ready(self, dpid: int, kind: str) -> None:
        self._logger.info("%s switch %#x connected", kind, dpid)
        self._record.write("switch", dpid=dpid, kind=kind)

    def note(self, note: Note) -> None:
        """Record a decision; log a refusal that hosts do not repeat by themselves."""
        fields: dict[str, Any] = {"session": f"{note.session:016x}"} if note.session else {}
        if note.setup_ms is not None:
            fields["setup_ms"] = round(note.setup_ms, 4)
        if note.detail:
            fields["detail"] = note.detail
        if note.event == "copy_late" and note.at is not None:
            fields["switch"] = self._network.name_of(note.at.dpid)
        if note.after is not None:
            after = {"session": f"{note.after.session:016x}", "ends": note.after.ends}
            fields |= {"ends": note.ends, "after": after}
        if note.asked is not None:
            fields |= request_view(note.asked, self._network)
        self._record.write(
            note.event, **fields, **self._light(note), packet_in_count=self.packet_in_count
        )
        busy = note.detail.startswith(Reason.BUSY.name)  # so hosts ask again
        if note.event == "refused" and note.at is not None and not busy:
            text = f"session {note.session:016x}: refused, {note.detail}"
            self._lines.add(note.at, text, self._clock())

    def _light(self, note: Note) -> dict[str, Any]:
        session = self._sessions.by_number.get(note.session)
        source = note.asked is not None and note.asked.setup.service == Service.PAIR_SOURCE
        if note.event not in ("granted", "moved") or session is None or source:
            return {}
        return {"light": light_view(session, self._network), **self._copies(note, session)}

    def _copies(self, note: Note, session: Session) -> dict[str, Any]:
        """Return how long after c0 each switch of a session's light had its set-up, in ms."""
        if not self.copied or note.asked is None:
            return {}
        seen, started = note.asked.seen, note.asked.started
        after_ms = {dpid: round((moment - started) * 1000, 4) for dpid, moment in seen.items()}
        path = switches(session.hops)
        return {"copies_ms": {self._network.name_of(dpid): after_ms.get(dpid) for dpid in path}}

    def drop(self, drop: Drop) -> None:
        self.dropped[drop.cause] += 1
        number, place = self.dropped[drop.cause], f"switch {drop.at.dpid:#x} port {drop.at.port}"
        text = f"dropped ({drop.cause}, {number} so far): {place}: {drop.detail}"
        self._lines.add(drop.at, text, self._clock())

    def forbidden(self, setup: Setup, connection: FiveTuple, objection: str) -> str:
        """Record a set-up that the policy forbids; return the reason with the names of both."""
        opener = name_of(self._network, connection.source)
        acceptor = name_of(self._network, connection.destination)
        self._record.write(
            "forbidden",
            session=f"{setup.session:016x}",
            service=Service(setup.service).name.lower(),
            **{"from": opener, "to": acceptor},
            detail=objection,
        )
        return f"{opener} to {acceptor}: {objection}"

    def policy(self, path: str) -> None:
        self._record.write("policy", path=path)

    def alarm(self, session: int, host: str, place: Place, links: Links, closed: bool) -> None:
        watched = names_of(links)
        text = f"{host}: alarm of its link monitor {session:016x} on {watched}"
        self._lines.add(place.at, text, self._clock(), WARNING)
        self._record.write(
            "alarm", session=f"{session:016x}", host=host, watched=watched, closed=closed
        )

    def monitor_over(self, host: str, report: DeviceReport, links: Links) -> None:
        self._record.write(
            "watched",
            session=f"{report.monitor:016x}",
            host=host,
            watched=names_of(links),
            compared=report.monitor_compared,
            errors=report.monitor_errors,
            tests_whole=report.monitor_tests,
            alarm=report.alarm == report.monitor,
            end=Reason(report.monitor_end).name,
        )

    def estimate(self, host: str, estimate: SessionEstimate) -> None:
        self._record.write(
            "estimate",
            session=f"{estimate.about:016x}",
            host=host,
            quantity=Quantity(estimate.quantity).name.lower(),
            **estimate.interval._asdict(),
        )
