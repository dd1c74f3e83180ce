"""A slow controller, or a slow way to it, turns into decoherence of memories.

    alice ===== pair in memory ===== bob ----- asks for the next link -----> h4
                  waits                         requests and answers of the controller

alice and bob have pairs; bob then asks for a link of his own to h4, as who passes entanglement on.
Both halves of the first pairs wait for the set-up of the second link: for switches that the
controller reaches over long copper, or for a controller to which other hosts send one
request after the other.
"""

import math
import re
from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

from evidence.curves.estimates import Estimate, mean_of_series, proportion
from evidence.curves.experiment import Experiment, Measure, Outcome, number
from evidence.curves.parameters import Parameter, Values
from evidence.networks.point_network import (
    CONTROLLER_DELAY,
    delay,
    network_for,
    session,
)
from evidence.traffic.session import AGREE, like_phi_plus
from hosts.client import BlockingSession
from qmn.scripting.network import QuantumNetwork
from qmn.timeouts import EMULATED_READY_S
from topologies.networks.network import Signals
from topologies.system.processes.programs import python
from wire.controller_lines import read_record
from wire.parameters.network import MOST_KM

KM = Parameter("control_km", 0.0, 0.0, MOST_KM, "km")
REQUESTERS = Parameter("requesters", 0, 0, 12)
T2 = Parameter("memory_t2_s", 2.0, 1e-3, 1e6, "s")
ROUNDS = Parameter("rounds", 20, 5, 1_000)
WAITED = Parameter("measured_wait_s", 0.0)
PAIRS = 300  # of a round, a third of them measured in each basis
HOSTS = 16
NEXT_PORT = 10  # bob's link to h4
PROGRAM = "evidence.networks.requests"
FIRST_REQUESTER = 5  # h5 asks h6, h6 asks h7, …
WAITED_S = re.compile(r"(?:after|to) ([0-9.e-]+)(?= to | s\b)")


def measure(values: Values, seed: int, runs: Path, _signals: Signals) -> Outcome:
    """Make pairs and ask for the next link, round after round."""
    t2_s = number(values, T2.name)
    options: dict[str, Any] = {
        "hosts": HOSTS,
        "switches": 1,  # hosts share no fibres, and light is never taken
        "seed": seed,
        "control_km": values[KM.name],
        "controller_delay": f"queued({delay(number(values, CONTROLLER_DELAY.name))})",
        "device": tuple(f"{host}.memory.t2_s={t2_s}" for host in ("alice", "bob")),
    }
    with network_for(CONTROL, values, runs, "tree", **options) as network:
        begin_requests(network, int(values[REQUESTERS.name]))
        rounds = [_round(network) for _ in range(int(values[ROUNDS.name]))]
        folder = network.runtime.logs
    return outcome(rounds, t2_s, folder)


def begin_requests(network: QuantumNetwork, requesters: int) -> None:
    names = [f"h{FIRST_REQUESTER + place}" for place in range(requesters + 1)]
    addresses = network.runtime.addresses
    for one, other in pairwise(names):
        command = [python(), "-m", PROGRAM, addresses[other], addresses[one]]
        program = network.run_on(one, f"requests.{one}", command)
        program.wait_for("ready", EMULATED_READY_S, network.check)


@dataclass(frozen=True)
class Round:
    pairs: str  # session of those that wait
    link: str  # session of the next link
    asked_ns: int  # when it was asked for
    right: dict[str, int]  # outcomes as Phi+ has them, by basis


def _round(network: QuantumNetwork) -> Round:
    """Store pairs until the next link is ready, and measure them then."""
    options: dict[str, Any] = {"sample": 0.0, "count": PAIRS, "source": "alice"}
    with session(network, "distribute", ("alice", "bob"), **options) as first:
        first.results()
        asked_ns = network.runtime.time.now_ns()
        following: dict[str, Any] = {"sample": 0.0, "count": 1, "source": "bob"}
        with session(network, "distribute", ("bob", "h4"), NEXT_PORT, **following) as second:
            second.results()
            right = {basis: agreeing(first, place) for place, basis in enumerate(AGREE)}
    return Round(first.summary["session"], second.summary["session"], asked_ns, right)


def agreeing(pairs: BlockingSession, place: int) -> int:
    """Measure a third of the pairs at both ends in a basis; return how many are as of Phi+."""
    basis = list(AGREE)[place]
    numbers = list(range(place, PAIRS, len(AGREE)))
    agree, _measured = like_phi_plus(pairs.ask(measure=numbers, basis=basis), basis)
    return agree


def outcome(rounds: Sequence[Round], t2_s: float, folder: Path) -> Outcome:
    """Return what was measured, with the waits that the dispatcher tells of each memory."""
    ready_ns = {
        line["session"]: line["time_ns"]
        for line in read_record(folder)
        if line["event"] == "path_ready"
    }
    setups_s = [(ready_ns[each.link] - each.asked_ns) / 1e9 for each in rounds]
    waits = waits_of((folder / "quantum.log").read_text().splitlines())
    coherences = [kept_of(waits[each.pairs], t2_s) for each in rounds]
    size = PAIRS // len(AGREE) * len(rounds)
    right = [proportion(sum(each.right[basis] for each in rounds), size) for basis in AGREE]
    value = (1 + sum(2 * each.value - 1 for each in right)) / 4
    fidelity = Estimate(value, math.hypot(*(each.error for each in right)) / 2)
    return {
        "setup_s": mean_of_series(setups_s),
        WAITED.name: Estimate(-t2_s * math.log(sum(coherences) / len(coherences)), 0.0),
        "fidelity": fidelity,
        "kept": fidelity,
    }


def waits_of(lines: Iterable[str]) -> dict[str, list[list[float]]]:
    """Return how long (s) what was measured first, second and so on was in memories.

    By session, a list for each memory. All that waits has waited until the next `wait`; a part of
    it that is recalled goes on until then.
    """
    passed: defaultdict[tuple[str, str], float] = defaultdict(float)
    by_node: defaultdict[tuple[str, str], list[float]] = defaultdict(list)
    for line in lines:
        columns = line.split()
        if len(columns) < 4 or columns[2] not in ("wait", "recall"):
            continue
        times = [float(each) for each in WAITED_S.findall(line)]
        key = columns[3].removeprefix("session="), columns[1]
        if columns[2] == "wait":
            passed[key] += sum(times) / len(times)
        else:
            by_node[key].append(passed[key] + sum(times) / len(times))
    sessions: defaultdict[str, list[list[float]]] = defaultdict(list)
    for (session_, _node), waits in by_node.items():
        sessions[session_].append(waits)
    return dict(sessions)


def kept_of(waits: Sequence[Sequence[float]], t2_s: float) -> float:
    """Return how much of the coherence pairs keep that have waited so long at either end.

    They are measured in X, then in Y, which tell of it.
    """
    coherent = [math.exp(-sum(halves) / t2_s) for halves in zip(*waits, strict=True)]
    return sum(coherent[:2]) / 2


def expected(values: Values) -> float:
    """Return the fidelity to Phi+ of pairs that dephase for the wait that was measured."""
    return (1 + math.exp(-number(values, WAITED.name) / number(values, T2.name))) / 2


CONTROL = Experiment(
    "control",
    "pairs in memories, and a controller that is far or busy",
    (KM, CONTROLLER_DELAY, REQUESTERS, T2, ROUNDS),
    (
        Measure("setup_s", "from the request for the next link to its light path (s)"),
        Measure(WAITED.name, "wait of both halves in memory, as dephasing averages it (s)"),
        Measure("fidelity", "fidelity of the pairs that wait"),
        Measure("kept", "fidelity of the pairs that wait", expected, over=WAITED),
    ),
)
