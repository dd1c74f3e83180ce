"""The exercises, and the parts of each by which it is done.

The right answers follow from closed forms, and from the runs themselves.
"""

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

from course.handed_in import HandedIn, Part, Run
from programs.shortest_paths import shortest
from wire.results.run_result import NetworkFacts

SIGMAS = 5
# 1: each half of a pair that becomes a symbol passes fibres: four and two.
NOISE, FIBERS = 0.01, 6
LEAST_BYTES, MOST_PAIRS_A_BYTE = 500, 12
# 2: drop UDP to this port.
COOKIE, PORT = 0xC0FFEE, 7777
UDP_DST = b"\x80\x00\x20\x02" + PORT.to_bytes(2, "big")  # OXM: class, field, length, value
# 3: an intercepted fraction f makes errors of f/4; no key is left at 11 % (Shor, Preskill).
ERRORS_OF_EVE, NO_KEY = 0.25, 0.11
# 5: what a network may cost.
MOST_FIBERS, LEAST_SWITCHES = 8, 4
# 6: median times from request to light.
WAIT, BETTER, LEAST_WORDS = 0.1, 0.7, 20


@dataclass(frozen=True)
class Exercise:
    title: str
    page: str
    runs: int
    check: Callable[[HandedIn], Iterator[Part]]


def near(value: float, right: float, tolerance: float) -> bool:
    """Return whether a value is within a relative tolerance; NaN is near nothing."""
    return abs(value - right) <= tolerance * abs(right)


def is_rate(events: float, trials: int, right: float) -> bool:
    """Return whether a count is within 5 standard errors of what it should be."""
    error = math.sqrt(right * (1 - right) / trials) if trials else 0.0
    return trials > 0 and abs(events / trials - right) <= SIGMAS * error


def ran(run: Run, *services: str) -> Part:
    return Part(
        run.result.service in services and run.is_captured,
        f"{run.folder.name}: a run of {' or '.join(services)} with its captures",
    )


def superdense(work: HandedIn) -> Iterator[Part]:
    (run,) = work.runs
    yield ran(run, "sdc")
    fibers = run.result.network.fibers if run.result.network else []
    noisy = bool(fibers) and all(fiber.depolarizing == NOISE for fiber in fibers)
    yield Part(noisy, f"every fibre has depolarizing {NOISE:g}")
    size = run.figures.delivered_bytes if run.result.service == "sdc" else 0
    text = f"{LEAST_BYTES} bytes or more, delivered exactly"
    yield Part(run.result.delivered and size >= LEAST_BYTES, text)
    few = size > 0 and run.figures.bell_pairs <= MOST_PAIRS_A_BYTE * size
    yield Part(few, f"at most {MOST_PAIRS_A_BYTE} pairs for each byte")
    right = 0.75 * (1 - (1 - NOISE) ** FIBERS)
    answer = near(work.number("symbol_error_rate"), right, 0.03)
    yield Part(answer, "symbol_error_rate: how many symbols are wrong, by your own calculation")


def controller_app(work: HandedIn) -> Iterator[Part]:
    (run,) = work.runs
    yield ran(run, "sdc")
    entries = [each for each in run.flow_mods() if each.cookie == COOKIE and each.command == 0]
    yield Part(bool(entries), f"an app adds a flow entry with cookie {COOKIE:#x}")
    yield Part(
        any(UDP_DST in each.match for each in entries), f"it matches UDP to port {PORT} at s1"
    )
    yield Part(
        bool(entries) and not any(each.instructions for each in entries),
        "it drops them: it has no instructions",
    )
    yield Part(run.result.delivered, "the message still arrives")


def eavesdropper(work: HandedIn) -> Iterator[Part]:
    tapped, whole = work.runs
    for run in work.runs:
        yield ran(run, "bb84")
    eve = getattr(tapped.result.job, "eve", None)
    fraction = float(eve.fraction) if eve is not None else 0.0
    yield Part(fraction > 0, "the first run has eve on the fibre (--eve)")
    alone = getattr(whole.result.job, "eve", None) is None
    yield Part(
        alone and bool(getattr(whole.figures, "key_bits", 0)),
        "the second has not, and leaves a key",
    )
    right = ERRORS_OF_EVE * fraction
    answer = fraction > 0 and near(work.number("qber"), right, 0.02)
    yield Part(answer, "qber: the error rate that eve's fraction makes, by your own calculation")
    errors = getattr(tapped.figures, "qber", None)
    compared = getattr(tapped.figures, "disclosed_bits", 0)
    right_rate = errors is not None and fraction > 0 and is_rate(errors * compared, compared, right)
    yield Part(right_rate, "the first run has measured that rate")
    yield Part(
        near(work.number("least_fraction"), NO_KEY / ERRORS_OF_EVE, 0.03),
        "least_fraction: how much eve has to measure so that no key is left",
    )


def nested(work: HandedIn) -> Iterator[Part]:
    nested_run, parallel_run = work.runs
    for run in work.runs:
        yield ran(run, "swap")
    schedules = [getattr(run.result.parameters, "schedule", "") for run in work.runs]
    yield Part(schedules == ["nested", "parallel"], "first --schedule nested, then parallel")
    waits = [getattr(run.figures, "sampled_waited_ms", None) or 0.0 for run in work.runs]
    alike = nested_run.network == parallel_run.network
    yield Part(alike, "both networks are the same")
    lost = alike and waits[0] > 1.05 * waits[1] > 0
    yield Part(lost, "pairs of the nested schedule have waited longer")
    ratio = waits[0] / waits[1] if waits[1] else float("inf")
    answer = math.isfinite(ratio) and near(work.number("waited_ratio"), ratio, 0.02)
    yield Part(answer, "waited_ratio: how many times as long, by your runs")
    yield Part(work.answers.get("last_repeater") == "q2", "last_repeater: who swaps last, of three")


def any_cut(work: HandedIn) -> Iterator[Part]:
    (run,) = work.runs
    yield ran(run, "bb84", "bbm92", "e91")
    facts = run.result.network
    between = ways_between_switches(facts) if facts else []
    switches = {name for way in between for name in way}
    yield Part(len(switches) >= LEAST_SWITCHES, f"{LEAST_SWITCHES} quantum switches or more")
    few = 0 < len(between) <= MOST_FIBERS
    yield Part(few, f"at most {MOST_FIBERS} fibres between them, and there are {len(between)}")
    yield Part(few and survives(between), "the switches stay joined, whichever way is cut")
    yield Part(bool(getattr(run.figures, "key_bits", 0)), "a key is made")


def ways_between_switches(facts: NetworkFacts) -> list[tuple[str, str]]:
    """Return the ends of each fibre between two switches."""
    switches = {switch.name for switch in facts.switches}
    ends = [(fiber.a.node, fiber.b.node) for fiber in facts.fibers]
    return [(one, other) for one, other in ends if {one, other} <= switches]


def survives(between: list[tuple[str, str]]) -> bool:
    """Return whether all switches are joined without the fibres of any one way."""
    nodes = {name for way in between for name in way}
    for cut in {frozenset(way) for way in between}:
        left: dict[str, dict[str, float]] = {node: {} for node in nodes}
        for one, other in between:
            if {one, other} != cut:
                left[one][other] = left[other][one] = 1.0
        if shortest(left, min(nodes)).keys() != nodes:
            return False
    return len(nodes) > 1


def scheduler(work: HandedIn) -> Iterator[Part]:
    first, scheduled = work.runs
    loads = [getattr(run.result.job, "load", None) for run in work.runs]
    ended = all(run.result.error is None for run in work.runs) and None not in loads
    alike = first.result.recorded_parameters == scheduled.result.recorded_parameters
    yield Part(
        ended and alike and first.result.seed == scheduled.result.seed,
        "two runs of `qmn run load` with the same options but --policy",
    )
    waits = [getattr(run.figures, "setup_p50_s", None) or 0.0 for run in work.runs]
    text = f"in the first, half of the sessions wait {WAIT:g} s or more"
    yield Part(ended and waits[0] >= WAIT, text)
    better = ended and 0 < waits[1] <= BETTER * waits[0]
    text = f"the second has at most {BETTER:g} of that median: {waits[0]:.3f} and {waits[1]:.3f} s"
    yield Part(better, text)
    accepted = [getattr(run.figures, "accepted", 0) for run in work.runs]
    as_many = ended and accepted[1] >= 0.9 * accepted[0] > 0
    yield Part(as_many, "it serves as many sessions, 90 % at least")
    why = len(str(work.answers.get("why", "")).split()) >= LEAST_WORDS
    yield Part(why, f"why: in {LEAST_WORDS} words or more, which a teacher reads")


EXERCISES: Mapping[int, Exercise] = {
    1: Exercise("Superdense coding over a noisy fibre", "1-superdense.md", 1, superdense),
    2: Exercise("Write the controller app", "2-controller.md", 1, controller_app),
    3: Exercise("Find eve", "3-eve.md", 2, eavesdropper),
    4: Exercise("Why does the nested schedule lose?", "4-nested.md", 2, nested),
    5: Exercise("Make the key service survive a cut", "5-cut.md", 1, any_cut),
    6: Exercise("Beat this scheduler", "6-scheduler.md", 2, scheduler),
}
