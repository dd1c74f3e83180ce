"""A summary of heavy traffic: what became of the sessions, and what the controller did."""

from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
from itertools import accumulate, pairwise
from math import sqrt
from types import MappingProxyType
from typing import Any

from evidence.traffic.session import Outcome
from wire.results.run_result import (
    ACCEPTED,
    BLOCKED,
    BROKEN,
    LATE,
    AgedFidelity,
    Load,
    LoadSession,
    LoadWait,
    Shares,
)

AGES = 5  # portions by age
SHARES = {"p50": 0.5, "p90": 0.9, "p99": 0.99}


def summary(
    outcomes: Sequence[Outcome],
    record: Sequence[dict[str, Any]],
    scale: float = 1.0,
    began_ns: int = 0,
    names: Mapping[str, str] = MappingProxyType({}),
) -> Load:
    """Return all that is counted; `record` are the controller's facts (wire.controller_lines).

    `scale` is how long a second of the network takes on their clock, on which the first session
    could be asked for at `began_ns`; `names` are the hosts' by their addresses.
    """
    accepted = [each for each in outcomes if each.outcome == ACCEPTED]
    span_s = max((each.ended_s for each in outcomes), default=0.0)
    left = [int(each.summary["pairs"]) for each in accepted if "pairs" in each.summary]
    pairs = sum(left)
    return Load(
        offered=len(outcomes),
        accepted=len(accepted),
        blocked=reasons(outcomes, BLOCKED),
        late=sum(each.outcome == LATE for each in outcomes),
        broken=reasons(outcomes, BROKEN),
        forgotten=sum(not each.outcome for each in outcomes),
        setup_s=shares([each.setup_s for each in outcomes if each.setup_s is not None]),
        **light_times(record, scale),
        waits=waits(record, scale, began_ns, names),
        span_s=span_s,
        **load(outcomes, accepted, span_s),
        pairs=pairs,
        pairs_per_s=pairs / span_s if left and span_s else None,
        fidelity_by_age=fidelity_by_age(accepted),
        fairness=fairness(outcomes),
        sessions=listed(outcomes),
    )


def load(outcomes: Sequence[Outcome], accepted: Iterable[Outcome], span_s: float) -> dict[str, Any]:
    """Return which load that was: sessions asked for a second, and under way at a time.

    `carried` is how many had light at a time on average, in erlang.
    """
    last_s = max((each.asked_s for each in outcomes), default=0.0)
    begins = [(each.asked_s, 1) for each in outcomes]
    ends = [(each.ended_s, -1) for each in outcomes]
    under_way = accumulate(step for _at_s, step in sorted([*begins, *ends]))
    lit_s = sum(each.ended_s - each.asked_s - (each.setup_s or 0.0) for each in accepted)
    return {
        "offered_per_s": len(outcomes) / last_s if last_s else None,
        "at_a_time": max(under_way, default=0),
        "carried": lit_s / span_s if span_s else None,
    }


def reasons(outcomes: Iterable[Outcome], kind: str) -> dict[str, int]:
    return dict(Counter(each.reason for each in outcomes if each.outcome == kind).most_common())


def shares(values: Sequence[float]) -> Shares:
    """Return the values that a half, 90 % and 99 % do not exceed, and how many there are."""
    in_order = sorted(values)
    counts = {
        name: in_order[min(int(share * len(in_order)), len(in_order) - 1)] if in_order else None
        for name, share in SHARES.items()
    }
    return Shares(**counts, n=len(in_order))


def light_times(record: Sequence[dict[str, Any]], scale: float) -> dict[str, Any]:
    """Return how many waited for light and how long, and how long light was held, in s."""
    first: dict[tuple[str, str], int] = {}
    for line in record:
        if "session" in line:
            first.setdefault((line["session"], line["event"]), line["time_ns"])
    waits, held = [], []
    queued = 0
    for (session, event), time_ns in first.items():
        if event == "queued":
            queued += 1
            ready = first.get((session, "path_ready"))
            waits += [(ready - time_ns) / 1e9 / scale] if ready is not None else []
        if event == "path_ready":
            end = first.get((session, "torn_down"))
            held += [(end - time_ns) / 1e9 / scale] if end is not None else []
    return {"queued": queued, "waited_s": shares(waits), "light_s": mean(held)}


def waits(
    record: Iterable[dict[str, Any]], scale: float, began_ns: int, names: Mapping[str, str]
) -> list[LoadWait]:
    queued: dict[str, int] = {}
    after: dict[str, dict[str, Any]] = {}
    rows = []
    for line in record:
        event, session = line["event"], line.get("session", "")
        if event == "queued":
            queued.setdefault(session, line["time_ns"])
        elif event == "light_after":
            after[session] = line
        elif event == "path_ready" and session in after:
            request, ready_ns = after.pop(session), line["time_ns"]
            opener, acceptor, *holders = (
                names.get(each, each) for each in (*request["ends"], *request["after"]["ends"])
            )
            ready_s, waited_s = (
                (ready_ns - since_ns) / 1e9 / scale
                for since_ns in (began_ns, queued.pop(session, ready_ns))
            )
            before = request["after"]["session"]
            rows.append(LoadWait(session, opener, acceptor, ready_s, waited_s, before, *holders))
    return sorted(rows, key=lambda each: -each.waited_s)


def mean(values: Sequence[float]) -> float | None:
    return sum(values) / len(values) if values else None


def fidelity_by_age(outcomes: Iterable[Outcome]) -> list[AgedFidelity]:
    """Return the fidelity to Phi+ of pairs by how long ago they were handed over.

    F = (1 + XX - YY + ZZ) / 4, of outcomes at both ends, a third of the pairs in each basis.
    """
    measured = sorted(
        (each for each in outcomes if len(each.measured) == 3), key=lambda each: each.age_s
    )
    bounds = [len(measured) * part // AGES for part in range(AGES + 1)]
    return [_estimate(measured[a:b]) for a, b in pairwise(bounds) if a < b]


def _estimate(portion: Sequence[Outcome]) -> AgedFidelity:
    right: defaultdict[str, int] = defaultdict(int)
    count: defaultdict[str, int] = defaultdict(int)
    for each in portion:
        for basis, number in each.measured.items():
            count[basis] += number
            right[basis] += each.right[basis]
    share = {basis: right[basis] / count[basis] if count[basis] else 0.5 for basis in count}
    variance = sum(s * (1 - s) / max(count[basis], 1) for basis, s in share.items())
    return AgedFidelity(
        age_s=sum(each.age_s for each in portion) / len(portion),
        fidelity=(1 + sum(2 * s - 1 for s in share.values())) / 4,
        standard_error=sqrt(variance) / 2,
        pairs=sum(count.values()),
    )


def fairness(outcomes: Iterable[Outcome]) -> float | None:
    """Return Jain's index of the openers' accepted shares: 1 if all fare alike, 1/n if one has all.

    R. Jain, D. Chiu, W. Hawe, DEC-TR-301 (1984).
    """
    offered: Counter[str] = Counter()
    accepted: Counter[str] = Counter()
    for each in outcomes:
        if each.opener:
            offered[each.opener] += 1
            accepted[each.opener] += each.outcome == ACCEPTED
    got = [accepted[host] / offered[host] for host in offered]
    squares = sum(share * share for share in got)
    return sum(got) ** 2 / (len(got) * squares) if squares else None


def listed(outcomes: Iterable[Outcome]) -> list[LoadSession]:
    """Return every session for result.json."""
    return [
        LoadSession(
            at_s=each.planned.at_s,
            asked_s=each.asked_s,
            opener=each.opener,
            acceptor=each.acceptor,
            others=list(each.others),
            outcome=each.outcome,
            reason=each.reason,
            text=each.text,
            setup_s=each.setup_s,
            ended_s=each.ended_s,
            priority=each.planned.priority,
            holding_s=each.planned.holding_s,
            pairs=each.summary.get("pairs"),
            session=each.summary.get("session"),
        )
        for each in outcomes
    ]
