"""A step of a handshake, in one of three layers."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from itertools import groupby

METADATA, OPENFLOW, QUANTUM = "metadata", "openflow", "quantum"


@dataclass(frozen=True)
class Step:
    """Something at one node, or on its way from one to another."""

    layer: str
    lane: str
    time_ns: int
    text: str
    to_lane: str = ""
    arrival_ns: int | None = None

    @property
    def moments(self) -> int:
        """How many times on the clock it has."""
        return 2 if self.arrival_ns is not None else 1


def together(steps: Iterable[Step]) -> list[Step]:
    """Return the steps, what was said or done at one time as often as that in one step."""
    found: list[Step] = []
    for (step, text), same in groupby(steps, lambda each: (replace(each, text=""), _kind(each))):
        texts = [each.text for each in same]
        if len(set(texts)) > 1:  # ways through a switch
            words = text + ", ".join(each.removeprefix(text) for each in texts)
        else:
            words = texts[0] + (f" × {len(texts)}" if len(texts) > 1 else "")  # noqa: RUF001
        found.append(replace(step, text=words))
    return found


def _kind(step: Step) -> str:
    """Return what the texts of steps that can be one have in common."""
    if step.layer == QUANTUM and not step.to_lane and "→" in step.text:
        return "".join(f"{word} " for word in step.text.split()[:2])  # as q1 open
    return step.text
