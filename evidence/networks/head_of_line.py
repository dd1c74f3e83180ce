"""Head-of-line blocking: a few long sessions keep all that come behind them waiting.

    a1, a2, … --- q1 ----- q2 --- b1, b2, …        one fibre, first come first served

Sessions come as a Poisson process; most hold their light for a short time, a share of them for a
long one. The load stays the same, as longer ones come more seldom; what grows is the second moment
of the holding time, and with it the wait of all: M/G/1, whose mean wait is
lambda E[S^2] / (2 (1 - rho)) (Pollaczek and Khinchine; L. Kleinrock, Queueing Systems I, 5.6).
"""

from collections.abc import Iterable, Sequence
from pathlib import Path
from random import Random
from typing import Any

from evidence.curves.estimates import Estimate, mean_of_series
from evidence.curves.experiment import Experiment, Measure, Outcome, SweepError, number
from evidence.curves.parameters import Parameter, Values
from evidence.networks.point_network import network_for
from evidence.traffic.driver import Driver
from evidence.traffic.plan import Planned
from evidence.traffic.session import Wanted
from hosts.network_loop import run
from topologies.fabric import FabricTopo
from topologies.networks.network import Signals
from wire.controller_lines import read_record
from wire.metadata.vocabulary import Service
from wire.results.run_result import ACCEPTED

LONG = Parameter("long_s", 1.0, 0.01, 5.0, "s")
SHORT = Parameter("short_s", 0.2, 0.01, 5.0, "s")
SHARE = Parameter("long_share", 0.1, 0.0, 1.0)
LOAD = Parameter("load", 0.25, 0.05, 0.9, "erlang")  # of holding times alone
SESSIONS = Parameter("sessions", 200, 20, 100_000)
EXPECTED = Parameter("expected_wait_s", 0.0)
HOSTS = 12  # on each side, more than there are sessions at a time
PAIRS = 1
Light = tuple[float, float, float]  # when a request came, had light, gave it back; s


class OneFiber(FabricTopo):
    """Hosts on both sides of one fibre."""

    def build(self, **settings: Any) -> None:
        self.set_up(**settings)
        self.add_dispatcher("10.0.0.250")
        one, other = self.add_quantum_switches(2)
        self.join(one, other, 1)
        for side, switch in enumerate((one, other)):
            for place in range(1, HOSTS + 1):
                name = f"{'ab'[side]}{place}"
                self.add_host(name, f"10.0.0.{100 * side + place}")
                self.join(name, switch, 1)


def measure(values: Values, seed: int, runs: Path, _signals: Signals) -> Outcome:
    sides = [[f"{side}{place}" for place in range(1, HOSTS + 1)] for side in "ab"]
    sessions = Wanted(Service.DISTRIBUTE, {"count": PAIRS, "sample": 0.0}, own_source=True)
    with network_for(
        HEAD_OF_LINE, values, runs, OneFiber, seed=seed, contention="queue"
    ) as network:
        stacks = {host: network.runtime.socket(host) for host in network.runtime.devices}
        groups = sides[0], sides[1]
        driver = Driver(planned(values, seed), sessions, stacks, groups, seed, network.runtime.time)
        run(driver.run(network.check), network.runtime.time)
        folder = network.runtime.logs
    others = [each.reason for each in driver.outcomes if each.outcome != ACCEPTED]
    if others:
        reasons = ", ".join(sorted(set(others)))
        text = f"{len(others)} sessions had no light: {reasons}"
        raise SweepError(f"{HEAD_OF_LINE.place(values)}: {text}")
    short = [each.summary["session"] for each in driver.outcomes if not each.planned.priority]
    return outcome(lights(read_record(folder)), short)


def planned(values: Values, seed: int) -> list[Planned]:
    random, now = Random(seed), 0.0  # noqa: S311
    share, times = number(values, SHARE.name), [number(values, e.name) for e in (SHORT, LONG)]
    mean_s = (1 - share) * times[0] + share * times[1]
    sessions = []
    for _ in range(int(values[SESSIONS.name])):
        now += random.expovariate(number(values, LOAD.name) / mean_s)
        is_long = random.random() < share
        sessions.append(Planned(now, "", "", times[is_long], priority=int(is_long)))
    return sessions


def lights(record: Iterable[dict[str, Any]]) -> dict[str, Light]:
    at: dict[str, dict[str, float]] = {}
    for line in record:
        if "session" in line:
            time_s = line["time_ns"] / 1e9
            at.setdefault(line["session"], {}).setdefault(line["event"], time_s)
    return {
        name: (events.get("queued", ready_s), ready_s, events["torn_down"])
        for name, events in at.items()
        if (ready_s := events.get("path_ready", 0.0)) and "torn_down" in events
    }


def outcome(light: dict[str, Light], short: Sequence[str]) -> Outcome:
    in_order = sorted(light, key=lambda name: light[name][0])
    waits = {name: ready - came for name, (came, ready, _ended) in light.items()}
    held = [ended - ready for _came, ready, ended in light.values()]
    came = [light[name][0] for name in in_order]
    waited = mean_of_series([waits[name] for name in in_order])
    return {
        "short_wait": mean_of_series([waits[name] for name in in_order if name in set(short)]),
        EXPECTED.name: Estimate(mean_wait_s((len(came) - 1) / (came[-1] - came[0]), held), 0.0),
        "wait": waited,
        "held": mean_of_series(held),
    }


def mean_wait_s(per_s: float, held_s: Sequence[float]) -> float:
    """Return the mean wait in an M/G/1 queue of these holding times."""
    first, second = (sum(held**power for held in held_s) / len(held_s) for power in (1, 2))
    return per_s * second / (2 * (1 - per_s * first))


def expected(values: Values) -> float:
    return number(values, EXPECTED.name)


HEAD_OF_LINE = Experiment(
    "head-of-line",
    "short sessions behind long ones, on one fibre",
    (LONG, SHORT, SHARE, LOAD, SESSIONS),
    (
        Measure("short_wait", "mean wait of short sessions for light (s)"),
        Measure(EXPECTED.name, "M/G/1 with the holding times that were measured (s)"),
        Measure("wait", "mean wait for light (s)", expected, over=EXPECTED),
        Measure("held", "mean time that light was held (s)"),
    ),
)
