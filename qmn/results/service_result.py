"""The part of a result that a run of a service adds: what both ends said at the end."""

from collections.abc import Mapping
from typing import Any, cast

from wire.results import schema
from wire.results.figures import ServiceFigures
from wire.results.run_result import KeysJob, LoadJob, NetqasmJob, ServiceJob

NOT_FIGURES = ("event", "peer")


def figures(line: Mapping[str, Any]) -> ServiceFigures:
    """Return what an end has said, without how; raise TypeError for what no service says."""
    told = {name: value for name, value in line.items() if name not in NOT_FIGURES}
    return cast("ServiceFigures", schema.read(cast("Any", ServiceFigures), told))


def rows(job: ServiceJob | KeysJob | LoadJob | NetqasmJob) -> dict[str, str]:
    """Return what a person is told of the service, and of who listened in."""
    if isinstance(job, NetqasmJob):
        return {}
    told = {name.replace("_", " "): number_text(value) for name, value in vars(job.asking).items()}
    if not isinstance(job, ServiceJob) or job.eve is None:
        return told
    eve = vars(job.eve).items()
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
