"""The result of heavy traffic: what became of all sessions, and how much each fibre was used."""

from pathlib import Path

from rich.console import Console

from qmn.results import result
from qmn.results.result import print_rows, rows_of_every_run
from qmn.results.run_result import RunResult
from qmn.results.service_result import number_text, rows
from topologies.system.runs.runtime import EVENT_CAPTURE
from views.events.event_sources import recorded
from views.fiber_use import fiber_use, shares, span_of
from wire.results.figures import LoadFigures
from wire.results.run_result import Load, LoadJob

BUSIEST = 3  # fibres that the table names


def complete(facts: RunResult, folder: Path) -> None:
    """Add the use of every fibre, and the first numbers to read; write result.json."""
    assert isinstance(facts.job, LoadJob)
    load, capture = facts.job.load, folder / EVENT_CAPTURE
    if load is not None:
        if facts.network is not None and capture.exists():
            events = (event for event in recorded(capture, follow=False) if not event.photon)
            use = fiber_use(facts.network, events)
            load.fibers = shares(use, *span_of(use))
        facts.job.asking, facts.elapsed_s = summary(load), load.span_s
    result.complete(facts, folder)


def summary(load: Load) -> LoadFigures:
    blocked, broken = sum(load.blocked.values()), sum(load.broken.values())
    return LoadFigures(
        sessions=load.offered,
        accepted=load.accepted,
        queued=load.queued,
        blocked=blocked,
        late=load.late,
        broken=broken,
        offered_per_s=load.offered_per_s,
        most_at_a_time=load.at_a_time,
        carried_erlang=load.carried,
        setup_p50_s=load.setup_s.p50,
        setup_p99_s=load.setup_s.p99,
        pairs_per_s=load.pairs_per_s,
        fairness=load.fairness,
        controller_ms_a_session=load.controller_ms,
    )


def show(console: Console, facts: RunResult, folder: Path, report: str) -> None:
    assert isinstance(facts.job, LoadJob)
    load = facts.job.load
    assert load is not None  # the network has started
    shown = rows(facts.job)
    for kind, reasons in (("blocked", load.blocked), ("broken", load.broken)):
        shown |= {f"{kind}: {reason}": number_text(count) for reason, count in reasons.items()}
    for age in load.fidelity_by_age:
        shown[f"fidelity after {age.age_s:.3g} s"] = (
            f"{age.fidelity:.4f} ± {age.standard_error:.4f}"
        )
    for longest in load.waits[:1]:
        shown["longest wait"] = (
            f"{longest.waited_s:.3g} s: {longest.opener} → {longest.acceptor}, for the light of "
            f"{longest.after_opener} → {longest.after_acceptor}"
        )
    used = sorted(load.fibers.items(), key=lambda item: -item[1])
    shown |= {f"use of {name}": f"{share:.1%}" for name, share in used[:BUSIEST]}
    print_rows(console, {**shown, **rows_of_every_run(facts, folder, report)})
