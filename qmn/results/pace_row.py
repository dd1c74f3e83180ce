"""The rows of a result about how time passed."""

from collections.abc import Iterator

from qmn.network.time_scale import PACED, STEPPED, Pace
from qmn.results.run_result import NetworkResult


def note_pace(facts: NetworkResult, pace: Pace) -> None:
    """Add how time passes, and why."""
    facts.time = STEPPED if pace.stepped else PACED
    facts.time_scale, facts.time_because = pace.scale, pace.reason or None


def rows(facts: NetworkResult) -> dict[str, str]:
    """Return the rows about time, for a person to read."""
    lines = {"time": time_text(facts)}
    if delays := [f"{name} {text}" for name, text in _stated(facts) if text]:
        lines["software takes"] = ", ".join(delays)
    early = facts.acausal
    if early is not None:
        lines["ACAUSAL"] = (
            f"news of {early.origin} can be at {early.receiver} {early.early_s:.3g} s before light"
        )
    return lines


def time_text(facts: NetworkResult) -> str:
    """Return how time passes, and why it does not stand while software runs."""
    if facts.time == STEPPED:
        return f"{STEPPED}: it stands while software runs"
    scale, reason = facts.time_scale or 1.0, facts.time_because
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
