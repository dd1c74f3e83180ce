"""A fibre that flaps: what is lost until the controller has found another way.

    alice --- q1 ===== q2 ===== q3 --- bob        the short way; q1 to q2 flaps
              ||                ||
              q5 ====== q4 =====                  the other one

Sessions come one behind the other, and each gets the short way if that is up. When it goes down,
light is lost until the controller has moved the session; then the session stays where it is. So a
fibre that flaps faster than sessions last costs no more than one cut for each of them.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from itertools import cycle
from pathlib import Path
from threading import Event as Flag
from threading import Thread
from typing import Any

from mininet.net import Mininet

from evidence.curves.estimates import Estimate, mean_of_series, proportion
from evidence.curves.experiment import Experiment, Measure, Outcome, number
from evidence.curves.parameters import Parameter, Values
from evidence.networks.point_network import CONTROLLER_DELAY, delay, network_for, session
from qmn.scripting.network import QuantumNetwork
from topologies.networks.network import Signals
from topologies.system.runs.runtime import EVENT_CAPTURE
from views.events.event_sources import recorded
from wire.dispatcher_pb2 import Event
from wire.parameters.fiber import Fiber, FiberEnd

PERIOD = Parameter("period_s", 2.0, 0.1, 600.0, "s")  # half of it down
PAIRS = Parameter("pairs", 100_000, 1_000, 1_000_000)
SESSIONS = Parameter("sessions", 15, 1, 10_000)
RATE_HZ = 100_000
BLOCK_PAIRS = 50_000  # half a second: there is light most of the time
DARK = Parameter("dark_share", 0.0)
ENDS = "alice", "bob"
FLAPPING_FIBER = "q1", "q2"
Span = tuple[int, int]  # ns


def measure(values: Values, seed: int, runs: Path, _signals: Signals) -> Outcome:
    """Share pairs by one session after the other while the fibre flaps."""
    wanted: dict[str, Any] = {"source": ENDS[0], "sample": 0.0, "count": int(values[PAIRS.name])}
    wanted |= {"block_pairs": BLOCK_PAIRS, "rate_hz": RATE_HZ}
    emitted = shared = 0
    times_s = []
    options: dict[str, Any] = {"switches": 5, "seed": seed}
    options["controller_delay"] = delay(number(values, CONTROLLER_DELAY.name))
    with network_for(FLAPPING, values, runs, "ring", **options) as network:
        with flapping(network, number(values, PERIOD.name)):
            for _ in range(int(values[SESSIONS.name])):
                with session(network, "distribute", ENDS, **wanted) as running:
                    running.results()
                    emitted += running.summary["emitted"]
                    shared += running.summary["shared"]
                    times_s.append(running.summary["elapsed_s"])
        folder, fibers = network.runtime.logs, list(network.runtime.fibers)
    events = [event for event in recorded(folder / EVENT_CAPTURE, follow=False) if not event.photon]
    lost = proportion(emitted - shared, emitted)
    return {
        "lost": lost,
        DARK.name: Estimate(dark_share(events, fibers), 0.0),
        "lost_in_the_dark": lost,
        "session_s": mean_of_series(times_s),
    }


@contextmanager
def flapping(network: QuantumNetwork, period_s: float) -> Iterator[None]:
    """Let the fibre go down and up again meanwhile, and leave it up."""
    enough = Flag()

    def flap() -> None:
        for state in cycle(("down", "up")):
            network.sleep(period_s / 2)
            if enough.is_set():
                break
            # Not ours, which waits for the controller: the fibre does not.
            Mininet.configLinkStatus(network.net, *FLAPPING_FIBER, state)
        network.net.configLinkStatus(*FLAPPING_FIBER, "up")

    thread = Thread(target=flap)
    thread.start()
    try:
        yield
    finally:
        enough.set()
        thread.join()


def dark_share(events: Sequence[Event], fibers: Sequence[Fiber]) -> float:
    """Return the share of the light's time in which no path stood from one end to the other."""
    spans = dark_spans(events, fibers, ENDS)
    light = [
        (event.time_ns, event.time_ns + round(event.photons / RATE_HZ * 1e9))
        for event in events
        if event.kind == "send" and event.node == ENDS[0]
    ]
    dark_ns = sum(max(0, min(a[1], b[1]) - max(a[0], b[0])) for a in light for b in spans)
    return dark_ns / sum(end - begin for begin, end in light)


def dark_spans(
    events: Iterable[Event], fibers: Iterable[Fiber], ends: tuple[str, str]
) -> list[Span]:
    """Return when no path stood from one host to another, until the last time that one did.

    Of cross-connects alone, as switches have opened and closed them.
    """
    far = {end: other for each in fibers for end, other in ((each.a, each.b), (each.b, each.a))}
    begins = [end for end in far if end.node == ends[0]]
    connects: dict[FiberEnd, FiberEnd] = {}
    spans: list[Span] = []
    dark_since: int | None = 0
    for event in events:
        if event.kind == "open":
            in_port, _arrow, out_port = event.detail.split()[:3]
            connects[FiberEnd(event.node, in_port)] = FiberEnd(event.node, out_port)
        elif event.kind == "close":
            connects.pop(FiberEnd(event.node, event.port), None)
        stands = any(leads_to(begin, ends[1], far, connects) for begin in begins)
        if stands and dark_since is not None:
            spans.append((dark_since, event.time_ns))
            dark_since = None
        elif not stands and dark_since is None:
            dark_since = event.time_ns
    return spans


def leads_to(
    begin: FiberEnd,
    host: str,
    far: Mapping[FiberEnd, FiberEnd],
    connects: Mapping[FiberEnd, FiberEnd],
) -> bool:
    """Tell whether light that leaves at a port comes to a host."""
    at = far[begin]
    for _hop in range(len(far)):
        if at.node == host:
            return True
        if at not in connects:
            return False
        at = far[connects[at]]
    return False


def lost_in_the_dark(values: Values) -> float:
    """Return the theory of lost: photons leave at a steady rate, and those in the dark are lost."""
    return number(values, DARK.name)


FLAPPING = Experiment(
    "flapping",
    "sessions over a fibre that flaps, and a way round it",
    (PERIOD, PAIRS, SESSIONS, CONTROLLER_DELAY),
    (
        Measure("lost", "pairs that are lost"),
        Measure(DARK.name, "share of the light's time without a path"),
        Measure("lost_in_the_dark", "pairs that are lost", lost_in_the_dark, over=DARK),
        Measure("session_s", "time that a session takes (s)"),
    ),
)
