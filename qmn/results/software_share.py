"""Time in a result: its scale, and how much of it was software."""

from collections.abc import Iterable, Iterator
from math import inf

from qmn.network.time_scale import PACED, SHARE, STEPPED, Pace
from qmn.results.run_result import NetworkResult
from wire.dispatcher_pb2 import SoftwareTime
from wire.parameters.physics import Device
from wire.results.run_result import ShortestTime

DOMINATED = 0.5  # of a wait
MATTERS = 0.01  # of the shortest time in which waiting does something


def note_pace(facts: NetworkResult, pace: Pace) -> None:
    """Add how time passes, and why."""
    facts.time = STEPPED if pace.stepped else PACED
    facts.time_scale, facts.time_scale_because = pace.scale, pace.reason or None


def note_software(
    facts: NetworkResult, software: SoftwareTime, devices: Iterable[Device], pace: Pace
) -> None:
    """Add how much was software; None where no qubit waited in a memory."""
    waited = software.largest_wait_share > 0 or software.longest_ns > 0
    longest_s = software.longest_ns / 1e9
    coherent_s = min((device.memory.shortest_s for device in devices), default=inf)
    facts.software_share = software.largest_wait_share if waited else None
    facts.software_s = longest_s if waited else None
    facts.software_share_of_run = software.run_share
    decayed = software.largest_decaying_share > DOMINATED
    facts.dominated_by_software = (
        decayed and longest_s > MATTERS * coherent_s and facts.time != STEPPED
    )
    if pace.shortest is not None:
        name, shortest_s = pace.shortest
        facts.shortest_time = ShortestTime(name, shortest_s)
        if waited:
            facts.software_of_shortest = share = longest_s / shortest_s
            facts.time_scale_kept = share < SHARE if pace.reason else None


def rows(facts: NetworkResult) -> dict[str, str]:
    """Return the rows about time, for a person to read; a scale of 1 needs none."""
    lines = {"time": time_text(facts)}
    share = facts.software_share
    if share is not None and facts.time != STEPPED:
        lines["software"] = (
            f"programs account for up to {share:.1%} of a wait in memory, {facts.software_s:.3g} s"
        )
        if share > DOMINATED and not facts.dominated_by_software:
            lines["software"] += "; no effect, as these memories do not decay in that time"
    if delays := [f"{name} {text}" for name, text in _stated(facts) if text]:
        lines["software takes"] = ", ".join(delays)
    early = facts.acausal
    if early is not None:
        lines["ACAUSAL"] = (
            f"news of {early.origin} can be at {early.receiver} {early.early_s:.3g} s before light"
        )
    if facts.time_scale_kept is False:
        lines["Warning"] = _missed(facts)
    if facts.dominated_by_software:
        lines["Warning"] = (
            "fidelity here is limited by this computer's speed, not by the network; "
            "use --time stepped, or --time paced=auto where that is refused"
        )
    return lines


def time_text(facts: NetworkResult) -> str:
    """Return how time passes, and why it does not stand while software runs."""
    if facts.time == STEPPED:
        return f"{STEPPED}: it stands while software runs"
    scale, reason = facts.time_scale or 1.0, facts.time_scale_because
    here = (
        "by the wall clock" if scale == 1.0 else f"a second of the network takes {scale:g} s here"
    )
    return f"{PACED}: {here}" + (f", as {reason}" if reason else "")


def _stated(facts: NetworkResult) -> Iterator[tuple[str, str]]:
    """Yield the delays of software that were stated, for each message."""
    settings = facts.settings
    yield "c0", settings.controller_delay
    yield "hosts", settings.host_delay
    yield "agents", settings.switch_agent_delay


def _missed(facts: NetworkResult) -> str:
    shortest, share = facts.shortest_time, facts.software_of_shortest
    assert shortest is not None  # there is a share of it
    assert share is not None
    assert facts.time_scale is not None
    return (
        f"software took up to {share:.2%} of {shortest.name}, {shortest.s:.3g} s, where "
        f"--time paced=auto means less than {SHARE:.0%}: a scale of "
        f"{facts.time_scale * share / SHARE:.3g} was needed"
    )
