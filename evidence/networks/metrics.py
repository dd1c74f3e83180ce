"""Metrics of a job in a network, by the names of the literature, and the theory of some.

docs/researchers.md has each with its formula and its source.
"""

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

from evidence.curves import theory
from evidence.curves.estimates import NOTHING, Estimate, proportion
from evidence.curves.experiment import Measure, Outcome
from evidence.curves.parameters import Values
from qmn.results.run_result import RunResult
from wire.results.figures import Figures
from wire.results.run_result import ServiceJob

INTERVAL = 2 * 1.96  # standard errors in a confidence interval of 95 %
RATES = "pairs_per_s", "states_per_s", "key_bits_per_s"
# Settings that the theory of pairs takes, and those that it does not depend on.
OF_PAIRS = {"node.memory.t2_s", "depolarizing", "switches", "waiting_s"}
FREE = {"count", "sample", "length_km", "loss_db_per_km", "block_pairs", "rate_hz", "copper_km"}
FREE |= {
    "copper_mbps",
    "message",
    "file",
    "controller_delay",
    "host_delay",
    "switch_agent_delay",
    "control_km",
}
FIBERS = {"swap": 1, "distribute": 4, "teleport": 4, "sdc": 6}  # passed by a pair; swap: a link's
DEFAULT_KM = 0.01
SWITCHES = 3  # of a chain

WITHOUT_DELIVERY = "qber", "key_fraction", "setup_s", "pairs_made"

Found = Callable[[RunResult, Figures, Figures], Estimate]  # of a result, of who asks, who is asked


def exactly(value: float | None) -> Estimate:
    return NOTHING if value is None else Estimate(value, 0.0)


def of_interval(name: str) -> Found:
    """Return what finds a figure with its standard error, or that of its interval."""

    def found(_result: RunResult, asking: Figures, _asked: Figures) -> Estimate:
        has = vars(asking)
        value, low, high = (has.get(each) for each in (name, f"{name}_low", f"{name}_high"))
        if value is None:
            return NOTHING
        if low is None or high is None:
            return Estimate(value, has.get(f"{name}_error") or 0.0)
        return Estimate(value, (high - low) / INTERVAL)

    return found


def arrived(_result: RunResult, asking: Figures, _asked: Figures) -> Estimate:
    has = vars(asking)
    if "bell_pairs" in has:
        return proportion(has["bell_pairs"] - has["lost_pairs"], has["bell_pairs"])
    return proportion(has["arrived"], has["states"]) if "arrived" in has else NOTHING


def symbol_errors(_result: RunResult, asking: Figures, _asked: Figures) -> Estimate:
    has = vars(asking)
    if "symbol_errors" not in has:
        return NOTHING
    return proportion(has["symbol_errors"], has["bell_pairs"] - has["lost_pairs"])


def key_fraction(result: RunResult, asking: Figures, _asked: Figures) -> Estimate:
    if "key_fraction" not in vars(asking):
        return NOTHING
    return exactly(vars(asking)["key_fraction"] if result.delivered else 0.0)


def throughput(_result: RunResult, asking: Figures, _asked: Figures) -> Estimate:
    return exactly(next((vars(asking)[rate] for rate in RATES if rate in vars(asking)), None))


def latency(result: RunResult, _asking: Figures, _asked: Figures) -> Estimate:
    return exactly(result.elapsed_s)


def setup(result: RunResult, _asking: Figures, _asked: Figures) -> Estimate:
    return exactly(None if result.path_setup_ms.p50 is None else result.path_setup_ms.p50 / 1e3)


def waiting(_result: RunResult, asking: Figures, acceptor: Figures) -> Estimate:
    waits = [*_waits_ms(asking), *_waits_ms(acceptor)]
    return exactly(sum(waits) / 1e3) if waits else NOTHING


def _waits_ms(figures: Figures) -> Iterator[float]:
    """Yield how long halves waited at an end, and those in switches, of which each keeps two."""
    has = vars(figures)
    if has.get("sampled_waited_ms") is not None:
        yield has["sampled_waited_ms"]
    elif has.get("waited_ms") is not None and "arrived" in has:  # of teleportation
        yield has["waited_ms"] / 2  # both ends report the same
    yield from (2 * each for each in has.get("repeaters_waited_ms") or ())


def memory_use(result: RunResult, asking: Figures, acceptor: Figures) -> Estimate:
    """Return the mean number of qubits in memories, by Little's law: their rate by their wait."""
    rate, wait = throughput(result, asking, acceptor), waiting(result, asking, acceptor)
    return NOTHING if math.isnan(rate.value + wait.value) else exactly(rate.value * wait.value)


def made(result: RunResult, _asking: Figures, _asked: Figures) -> Estimate:
    return exactly(result.pairs_made)


@dataclass(frozen=True)
class Metric:
    """A number of a job: its axis label, and what finds it."""

    name: str
    label: str
    found: Found


METRICS = (
    Metric("waiting_s", "waiting time of a pair's halves in memories, summed (s)", waiting),
    Metric("fidelity", "fidelity", of_interval("fidelity")),
    Metric("qber", "quantum bit error rate", of_interval("qber")),
    Metric("key_fraction", "secret-key fraction", key_fraction),
    Metric("throughput_per_s", "throughput (pairs, states or key bits a second)", throughput),
    Metric("memory_use", "qubits in memories, mean", memory_use),
    Metric("latency_s", "latency of the whole job (s)", latency),
    Metric("setup_s", "from request to light path, median (s)", setup),
    Metric("symbol_error_rate", "symbol error rate", symbol_errors),
    Metric("arrived", "part of the pairs that arrives", arrived),
    Metric("pairs_made", "pairs made by sources", made),
)


def outcome_of(result: RunResult) -> Outcome:
    """Return every metric of a job; NaN for what it does not have, or if light is too noisy."""
    assert isinstance(result.job, ServiceJob)
    return {
        metric.name: metric.found(result, result.job.asking, result.job.asked)
        if result.delivered or metric.name in WITHOUT_DELIVERY
        else NOTHING
        for metric in METRICS
    }


def pair_fidelity(job: str, values: Values) -> float | None:
    """Return that of pairs over depolarising fibres and dephasing memories; waits are measured.

    Phi+ keeps ZZ by the fibres, XX and YY by the fibres and e^(-t/T2) for the sum t of all waits.
    """
    if not values.keys() <= OF_PAIRS | FREE or math.isnan(_number(values, "waiting_s", math.nan)):
        return None
    links = int(_number(values, "switches", SWITCHES)) + 1 if job == "swap" else 1
    intact = (1 - _number(values, "depolarizing", 0.0)) ** (FIBERS[job] * links)
    lasting = math.exp(-_number(values, "waiting_s", 0.0) / _number(values, "node.memory.t2_s"))
    return (1 + intact * (1 + 2 * lasting)) / 4


def teleported(_job: str, values: Values) -> float | None:
    if not values.keys() <= OF_PAIRS | FREE - {"switches"} | {"state", "node.memory.t1_s"}:
        return None
    waited_s = _number(values, "waiting_s", math.nan)
    p = theory.together(*[_number(values, "depolarizing", 0.0)] * FIBERS["teleport"])
    t1_s, t2_s = (_number(values, f"node.memory.{name}") for name in ("t1_s", "t2_s"))
    return None if math.isnan(waited_s) else theory.waited_fidelity(waited_s, t1_s, t2_s, p)


def dibit_error(_job: str, values: Values) -> float | None:
    if not values.keys() <= {"depolarizing", "frame_bytes", "fec", "interleave"} | FREE:
        return None
    p = _number(values, "depolarizing", 0.0)
    return theory.dibit_error(theory.together(*[p] * FIBERS["sdc"]))


def transmitted(_job: str, values: Values) -> float | None:
    if not values.keys() <= {"depolarizing", "frame_bytes", "fec", "interleave"} | FREE:
        return None
    loss_db = _number(values, "length_km", DEFAULT_KM) * _number(values, "loss_db_per_km", 0.0)
    return theory.transmission(FIBERS["sdc"] * loss_db)


def error_rate(_job: str, values: Values) -> float | None:
    """Return that of BB84 with one who measures and sends on a part of the photons."""
    return _number(values, "eve", 0.0) / 4 if values.keys() <= {"eve"} | FREE else None


def _number(values: Values, name: str, default: float = math.inf) -> float:
    return float(values.get(name, default))


Theory = Callable[[str, Values], float | None]
THEORY: Mapping[tuple[str, str], tuple[Theory, tuple[str, ...]]] = {
    ("swap", "fidelity"): (pair_fidelity, ("waiting_s",)),
    ("distribute", "fidelity"): (pair_fidelity, ("waiting_s",)),
    ("teleport", "fidelity"): (teleported, ("waiting_s",)),
    ("sdc", "symbol_error_rate"): (dibit_error, ()),
    ("sdc", "arrived"): (transmitted, ()),
    ("qkd", "qber"): (error_rate, ()),
}


def measures_of(job: str) -> tuple[Measure, ...]:
    """Return the measures of a job's sweep, each with its theory, if one is declared."""
    return tuple(_measure(job, metric) for metric in METRICS)


def _measure(job: str, metric: Metric) -> Measure:
    if (job, metric.name) not in THEORY:
        return Measure(metric.name, metric.label)
    function, needs = THEORY[job, metric.name]
    return Measure(metric.name, metric.label, lambda values: function(job, values), given=needs)
