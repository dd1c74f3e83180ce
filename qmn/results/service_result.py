"""The part of a result that a run of a service adds: what both ends said at the end."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from qmn.results.schema import RunFacts

NOT_NUMBERS = ("event", "peer")


def complete(facts: RunFacts, _folder: Path) -> None:
    """Keep what both ends have said."""
    facts["asking"] = numbers(facts.get("asking", {}))
    facts["asked"] = numbers(facts.get("asked", {}))


def numbers(told: Mapping[str, Any]) -> dict[str, Any]:
    """Return what an end has said, without how it said it."""
    return {name: value for name, value in told.items() if name not in NOT_NUMBERS}


def rows(facts: RunFacts) -> dict[str, str]:
    """Return what a person is told of the service, and of who listened in."""
    told = {name.replace("_", " "): number_text(value) for name, value in facts["asking"].items()}
    eve = {
        f"eve: {name.replace('_', ' ')}": number_text(v) for name, v in facts.get("eve", {}).items()
    }
    return {**told, **eve}


def number_text(value: Any) -> str:
    """Return a number as people read it."""
    if value is None:
        return "not known"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:,.4g}" if abs(value) < 10_000 else f"{value:,.0f}"
    return f"{value:,}" if isinstance(value, int) else str(value)
