"""Contention for light: the controller's own arbiter on a trunk of channels, in counted time.

    a1, a2, … --- q1 ===== q2 --- b1, b2, …

Sessions are asked for as a Poisson process, by real set-up messages; a time that is counted takes
the place of the clock, and switches take none. The hosts that take part are idle ones. Channels are
fibres of their own, or wavelengths of one fibre, of which the controller chooses one.
"""

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass, field
from heapq import heappop, heappush
from random import Random

from controller_apps.light.optics import SwitchOptics, SwitchPort
from controller_apps.light.paths import HostPort, Network
from controller_apps.sessions.actions import Action, Note, OpenPaths
from controller_apps.sessions.arbiter import Arbiter
from evidence.curves.estimates import NOTHING, Estimate, ratio
from evidence.curves.experiment import Outcome, SweepError
from evidence.curves.parameters import Point
from evidence.traffic.counted import FIN, FIRST_SEQUENCE, PUSH, segment
from evidence.traffic.erlang import erlang_b, erlang_c, mean_wait
from wire.metadata.setup import SETUP_LENGTH, Setup
from wire.metadata.vocabulary import Handshake, Service
from wire.optical import ANY_PORT, ANY_WAVELENGTH, TX_PWR, USE_FREQ, PathOptics, PortOptics
from wire.parameters.fiber import FiberOptics

S1, Q1, Q2 = 1, 2, 3  # datapath ids
PAIRS = 100  # of hosts, more than there are in sessions and in the queue
BATCHES = 40  # of sessions one after the other; the first is left out, as it begins empty
BUDGET_DB = 30.0
FOR_EVER_S = 1e12  # the queue's patience, and that with silent sessions


def address(side: int, pair: int) -> str:
    return f"10.0.{side}.{pair + 1}"


def trunk(channels: int, wavelengths: bool = False) -> Network:
    """Return the network as it would have been discovered; wavelengths: of one fibre."""
    network = Network({Q1, Q2})
    for dpid, side in ((Q1, 0), (Q2, 1)):
        network.optics.switches[dpid] = SwitchOptics(PathOptics(ANY_PORT, ANY_PORT, 0, 0))
        for pair in range(PAIRS):
            name = f"{'ab'[side]}{pair}"
            host = HostPort(name, address(side, pair), f"{name}-q0")
            network.attach(SwitchPort(dpid, pair + 1), host)
    for channel in range(channels):
        port = PAIRS + 1 + channel
        network.add_link(SwitchPort(Q1, port), SwitchPort(Q2, port))
        if wavelengths:
            fixed = (FiberOptics(channels=channels).channel_mhz(channel + 1),) * 2
            for dpid in (Q1, Q2):
                described = PortOptics(TX_PWR | USE_FREQ, *fixed, 0, *fixed, 0, 0, 0)
                network.optics.described(SwitchPort(dpid, port), described)
    return network


@dataclass
class Trunk:
    """Sessions that come, get light or not, and go."""

    arbiter: Arbiter
    holding_s: "Iterable[float]"
    idle: deque[int] = field(default_factory=lambda: deque(range(PAIRS)))
    pairs: dict[int, int] = field(default_factory=dict)  # of hosts, by session
    asked: dict[int, float] = field(default_factory=dict)  # when, by session
    waited: dict[int, float] = field(default_factory=dict)  # how long
    blocked: set[int] = field(default_factory=set)
    ends: list[tuple[float, int]] = field(default_factory=list)  # of sessions with light

    def ask(self, session: int, now: float) -> None:
        if not self.idle:
            raise SweepError(f"over {PAIRS} sessions wait for light at a time: choose less load")
        pair = self.pairs[session] = self.idle.popleft()
        self.asked[session] = now
        bb84, framed, opener = Service["BB84"], Handshake.FRAMED, address(0, pair)
        setup = Setup(session, bb84, framed, opener, 1, 1, 1, wavelength_pm=ANY_WAVELENGTH)
        self._say(session, FIRST_SEQUENCE, PUSH, now, setup.encode())

    def end_until(self, now: float) -> None:
        """Let the sessions end whose time is over by then, in order."""
        while self.ends and self.ends[0][0] <= now:
            end_s, session = heappop(self.ends)
            self._say(session, FIRST_SEQUENCE + SETUP_LENGTH, FIN, end_s)
            self.idle.append(self.pairs.pop(session))

    def _say(self, session: int, sequence: int, flags: int, now: float, data: bytes = b"") -> None:
        pair, source_port = self.pairs[session], 1_024 + session % 60_000
        sent = segment((address(0, pair), address(1, pair)), source_port, sequence, flags, data)
        self._obey(self.arbiter.segment_arrived(S1, 1, sent, now), now)

    def _obey(self, actions: Iterable[Action], now: float) -> None:
        """Do what switches do, at once; note who has light and who is refused."""
        for action in actions:
            if isinstance(action, OpenPaths):
                passed = self.arbiter.barrier_passed(action.dpid, action.transaction, now)
                self._obey(passed, now)
            elif isinstance(action, Note) and action.event == "path_ready":
                self.waited[action.session] = now - self.asked[action.session]
                heappush(self.ends, (now + next(iter(self.holding_s)), action.session))
            elif isinstance(action, Note) and action.event == "refused":
                self.blocked.add(action.session)
                self.idle.append(self.pairs.pop(action.session))


async def contend(v: Point, seed: int) -> Outcome:
    """Ask for sessions one after the other, and count who was blocked and who waited."""
    random, count, queues = Random(seed), int(v.sessions), v["contention"] == "queue"  # noqa: S311
    if queues and v.load >= v.channels:
        return dict.fromkeys(("blocked", "waited", "wait"), NOTHING)  # the queue never ends
    exponential = v["holding"] == "exponential"
    holding_s = iter(lambda: random.expovariate(1.0) if exponential else 1.0, None)
    network = trunk(int(v.channels), v["trunk"] == "wavelengths")
    arbiter = Arbiter(network, FOR_EVER_S, FOR_EVER_S, BUDGET_DB, queues)
    state, now = Trunk(arbiter, holding_s), 0.0
    for session in range(1, count + 1):
        now += random.expovariate(v.load)
        state.end_until(now)
        state.ask(session, now)
    state.end_until(FOR_EVER_S)
    return {
        "blocked": batched(count, dict.fromkeys(state.blocked, 1.0)),
        "waited": batched(count, {session: 1.0 for session, s in state.waited.items() if s}),
        "wait": batched(count, state.waited),
    }


def of_trunk(v: Point) -> dict[str, float | None]:
    """Refusals are the same for holding times of any distribution, waits are not."""
    load, channels = v.load, int(v.channels)
    if v["contention"] == "refuse":
        return {"blocked": erlang_b(load, channels), "waited": 0.0, "wait": 0.0}
    theory: dict[str, float | None] = dict.fromkeys(("blocked", "waited", "wait"))
    if load < channels:
        theory["blocked"] = 0.0
        if v["holding"] == "exponential":
            theory["waited"] = erlang_c(load, channels)
            theory["wait"] = mean_wait(load, channels, 1.0)
    return theory


def batched(count: int, values: dict[int, float]) -> Estimate:
    """Return the mean over sessions, those without a value being 0, with the error of batches."""
    size = count // BATCHES
    sums = [0.0] * BATCHES
    for session, value in values.items():
        batch = (session - 1) // size
        if batch < BATCHES:
            sums[batch] += value
    return ratio(sums[1:], [size] * (BATCHES - 1))
