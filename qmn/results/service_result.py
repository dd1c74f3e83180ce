"""The part of a result that a run of a service adds: what both ends said at the end."""

from typing import Any

from wire.results.run_result import Figures, KeysJob, LoadJob, NetqasmJob, ServiceJob

NOT_NUMBERS = ("event", "peer")


def numbers(told: Figures) -> Figures:
    """Return what an end has said, without how it said it."""
    return {name: value for name, value in told.items() if name not in NOT_NUMBERS}


def rows(job: ServiceJob | KeysJob | LoadJob | NetqasmJob) -> dict[str, str]:
    """Return what a person is told of the service, and of who listened in."""
    if isinstance(job, NetqasmJob):
        return {}
    told = {name.replace("_", " "): number_text(value) for name, value in job.asking.items()}
    if (job.asking.get("net_key_bits") or 0) < 0:
        told["net key bits"] += " (its session has used more of older keys than it has made)"
    if not isinstance(job, ServiceJob) or job.eve is None:
        return told
    eve = job.eve.items()
    return told | {f"eve: {name.replace('_', ' ')}": number_text(value) for name, value in eve}


def number_text(value: Any) -> str:
    """Return a number as people read it."""
    if value is None:
        return "not known"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:,.4g}" if abs(value) < 10_000 else f"{value:,.0f}"
    return f"{value:,}" if isinstance(value, int) else str(value)
