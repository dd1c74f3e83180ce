"""The light paths of sessions: opened, moved to another way, closed.

    open --> stands --port cut, switch gone--> moved, or stranded until it is whole again
                `--> closed

The receiver knows from the set-up which rotation to undo. So a path is moved only to one
of the same rotation; without such, the light is lost and the sender gives up in its time.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from itertools import count

from controller_apps.light.obstacles import on_the_way
from controller_apps.light.optics import SwitchPort
from controller_apps.light.paths import Hop, Network, switches
from controller_apps.light.routing import LightPath, rotation_of, route
from controller_apps.sessions.actions import (
    Action,
    ClosePaths,
    Flood,
    KeepPulses,
    Note,
    OpenPaths,
)
from controller_apps.sessions.admission import limits_of
from controller_apps.sessions.returns import borrowed_rotation
from controller_apps.sessions.sessions import Request, Session, Sessions
from controller_apps.sessions.snapshot import keep
from controller_apps.sessions.swap_turns import Command, Due, Release, heralds_to_hosts
from wire.analyser_frames import frames_of, group_of


@dataclass
class Move:
    session: int
    started: float
    waiting: set[int]  # switches that owe a barrier reply


@dataclass
class Light:
    network: Network
    sessions: Sessions
    budget_mdb: int
    needs_copies: bool = False  # of its set-up at all switches, before a request's paths are opened
    moves: dict[int, Move] = field(default_factory=dict)  # by transaction
    _transactions: Iterator[int] = field(default_factory=lambda: count(1))

    def open(
        self, request: Request, session: Session, paths: tuple[LightPath, ...]
    ) -> list[Action]:
        hops = tuple(hop for path in paths for hop in path.hops)
        # An earlier connection of the session may still keep its path: it is handed over.
        stale = self.close(session) if session.hops != hops else []
        self.sessions.occupy(session, paths, request.five_tuple)
        self.hold(request)
        request.waiting = set(switches(hops))
        borrowed = borrowed_rotation(request.setup, request.five_tuple, self.sessions, self.network)
        request.rotation = rotation_of(paths) ^ borrowed
        request.unseen = request.waiting - request.seen.keys() if self.needs_copies else set()
        return stale if request.unseen else [*stale, *self.program(request, session)]

    def program(self, request: Request, session: Session) -> list[Action]:
        hops = session.hops
        if session.turns is not None:
            hops = tuple(hop for hop in hops if hop not in session.turns.hops)
        return self._program(session, (), hops, request.transaction)

    def release(self, session: Session, due: Due) -> list[Action]:
        """Name or purify pulses at ends; the first time lead memories to their analyser."""
        return [action for each in due for action in self._released(session, each)]

    def _released(self, session: Session, due: Command | Release) -> Iterator[Action]:
        if isinstance(due, Release):
            hops, number = (due.swap[0].dpid, due.swap), session.number
            transaction = next(self._transactions)
            yield OpenPaths(*hops, number, transaction, reports=True, place=due.place)
        elif isinstance(due.at, SwitchPort):
            yield KeepPulses(*due.at, due.frame)
        elif session.turns is not None:
            group = group_of(session.number, due.at)
            for frame in frames_of(due.frame):
                yield Flood(session.turns.hosts.dpid, frame.encode(group, bytes(6)))

    def hold(self, request: Request) -> None:
        request.transaction = next(self._transactions)
        self.sessions.held[request.transaction] = request

    def close(self, session: Session) -> list[Action]:
        dark: list[Action] = [ClosePaths(dpid, session.number) for dpid in switches(session.hops)]
        self.sessions.vacate(session)
        self._forget_moves(lambda move: move.session == session.number)
        return dark

    def is_broken(self, session: Session) -> bool:
        return not self.network.is_whole(session.hops)

    def move(self, session: Session, now: float) -> list[Action] | None:
        """Take the paths of a session that are broken elsewhere; None if there is no way."""
        broken = [path for path in session.paths if not self.network.is_whole(path.hops)]
        whole = [path for path in session.paths if path not in broken]
        paths_found = route(
            self.network,
            [path.leg for path in broken],
            limits_of(session.setup, session.frequency_mhz, self.sessions, self.budget_mdb),
            whole,
            [path.rotation for path in broken],
        )
        if paths_found is None:
            return None
        other = dict(zip(broken, paths_found, strict=True))
        before = session.hops
        paths = tuple(other.get(path, path) for path in session.paths)
        self.sessions.occupy(session, paths, session.light_owner)
        transaction = next(self._transactions)
        actions = self._program(session, before, session.hops, transaction)
        waiting = {action.dpid for action in actions if isinstance(action, OpenPaths)}
        self.moves[transaction] = Move(session.number, now, waiting)
        if session.light_owner == session.owner:
            actions.insert(0, keep(session))
        return actions

    def _program(
        self, session: Session, before: tuple[Hop, ...], after: tuple[Hop, ...], transaction: int
    ) -> list[Action]:
        """Return what takes each switch from the hops before to those after."""
        actions: list[Action] = []
        for dpid in switches((*after, *before)):
            new = tuple(h for h in after if h.dpid == dpid and h not in before)
            taken_over = {hop.in_port for hop in new}
            old = tuple(
                h
                for h in before
                if h.dpid == dpid and h not in after and h.in_port not in taken_over
            )
            if dpid not in switches(after):
                actions.append(ClosePaths(dpid, session.number))
            elif new or old:
                tuned = self._tune(new, session.frequency_mhz)
                frequency = session.frequency_mhz if tuned else 0
                reports = session.turns is not None and bool(session.turns.stations)
                actions.append(
                    OpenPaths(
                        dpid,
                        new,
                        session.number,
                        transaction,
                        closed=old,
                        tuned=tuned,
                        frequency_mhz=frequency,
                        reports=reports,
                        heard=heralds_to_hosts(session.paths, dpid),
                    )
                )
        return actions

    def _tune(self, hops: tuple[Hop, ...], frequency_mhz: int) -> tuple[int, ...]:
        """Return which ports of one switch need tuning, and note that they get it."""
        ports = [SwitchPort(hop.dpid, port) for hop in hops for port in hop[1:]]
        optics = self.network.optics
        tuned = [at for at in dict.fromkeys(ports) if optics.must_tune(at, frequency_mhz)]
        optics.tuned_mhz.update(dict.fromkeys(tuned, frequency_mhz))
        return tuple(at.port for at in tuned)

    def doubt_tuning(self, session: Session) -> None:
        """Note that ports of a session may not be tuned as ordered."""
        for hop in session.hops:
            for port in hop[1:]:
                self.network.optics.tuned_mhz.pop(SwitchPort(hop.dpid, port), None)

    def strand(self, session: Session) -> list[Action]:
        """Note that there is no other way, once."""
        if session.stranded:
            return []
        session.stranded = True
        broken = "; ".join(obstacle.text for obstacle in on_the_way(self.network, session.hops))
        text = f"{broken}: no other way of the same rotation"
        return [Note("stranded", session.number, detail=text)]

    def barrier_passed(self, dpid: int, transaction: int, now: float) -> list[Action]:
        """Note that a switch has done its part of a move."""
        move = self.moves.get(transaction)
        if move is None:
            return []
        move.waiting.discard(dpid)
        if move.waiting:
            return []
        del self.moves[transaction]
        return [Note("moved", move.session, (now - move.started) * 1000)]

    def switch_left(self, dpid: int) -> None:
        for move in self.moves.values():
            move.waiting.discard(dpid)
        self._forget_moves(lambda move: not move.waiting)

    def overdue(self, before: float) -> list[Session]:
        """Return the sessions whose move began before then and is not complete."""
        late = dict.fromkeys(m.session for m in self.moves.values() if m.started <= before)
        return [self.sessions.by_number[number] for number in late]

    def entries_found(self, dpid: int, entries: Iterable[tuple[int, Hop | None]]) -> list[Action]:
        """Close what a switch kept of its past, and open again what it has lost.

        Each entry is a session and a hop, None if it is not a path any more.
        """
        hops: dict[int, set[Hop | None]] = {}
        for number, hop in entries:
            hops.setdefault(number, set()).add(hop)
        lit = [session.number for session in self.sessions.by_number.values() if session.paths]
        actions: list[Action] = []
        for number in sorted({*hops, *lit}):
            actions += self._reconcile(dpid, number, hops.get(number, set()))
        return actions

    def _reconcile(self, dpid: int, number: int, hops: set[Hop | None]) -> list[Action]:
        session = self.sessions.by_number.get(number)
        expected = [hop for hop in session.hops if hop.dpid == dpid] if session else []
        if session is None or not expected:
            return [ClosePaths(dpid, number)] if hops else []
        lost = tuple(hop for hop in expected if hop not in hops)
        session.confirmed |= len(lost) < len(expected)
        if not session.confirmed:
            session.missing += lost
            lost = ()
        stale = tuple(sorted(hop for hop in hops if hop is not None and hop not in expected))
        if not lost and not stale:
            return []
        return [OpenPaths(dpid, lost, number, next(self._transactions), stale)]

    def restore(self, session: Session) -> list[Action]:
        """Open what switches that are here have lost of a session."""
        missing, session.missing = session.missing, ()
        return [
            OpenPaths(
                dpid,
                tuple(hop for hop in missing if hop.dpid == dpid),
                session.number,
                next(self._transactions),
            )
            for dpid in switches(missing)
        ]

    def _forget_moves(self, over: Callable[[Move], bool]) -> None:
        self.moves = {number: move for number, move in self.moves.items() if not over(move)}
