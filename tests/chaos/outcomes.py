"""Outcomes of strikes at a run: whether all was right, in words, and counted."""

import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

from strikes import OUTPUT, RUNNER, Strike
from under_way import PHASES, Moment

NO_LIGHT = "no light: "
FAILED = re.compile(r"s  \w+: failed: .*? \((.+)\)$")  # of time_series.words
NAMED_S, STALLED_NAMED_S = 5.0, 30.0


@dataclass(frozen=True)
class Made:
    """A strike, and when it was made."""

    strike: Strike
    phase: str
    after_s: float  # since the first one


@dataclass
class Outcome:
    """The results of the strikes at one run."""

    number: int
    job: str
    moment: Moment
    made: list[Made]
    status: int | None  # of the run; None: it hung
    cause: str = ""
    cause_after_s: float | None = None  # since the first strike
    last_words: list[str] = field(default_factory=list)
    slowed: float = 1.0  # by others, as machine.slowed says
    ended_after_s: float | None = None  # since the last one
    faults: list[str] = field(default_factory=list)
    leftovers: list[str] = field(default_factory=list)

    @property
    def suspects(self) -> list[Made]:
        """The strikes that may have been the cause: those that it names, if there are any."""
        before = [made for made in self.made if made.after_s <= (self.cause_after_s or 0.0)]
        return [made for made in before if self._names(made)] or before

    def _names(self, made: Made) -> bool:
        return any(name in self.cause for name in made.strike.names)

    @property
    def blames_another(self) -> bool:
        """Whether something else is named than what was struck and must have been the cause.

        Of several strikes any may be named. One that names nothing, or that need not end a run, may
        be what another cause is of: then that may be true, too.
        """
        suspects = self.suspects if self.cause else []
        must = [made for made in suspects if made.strike.names]
        return bool(must) and len(must) == len(suspects) and not any(map(self._names, must))

    @property
    def named_after_s(self) -> float | None:
        """How long after the strike that it is about the cause was named."""
        if self.cause_after_s is None or not self.suspects:
            return None
        return round(self.cause_after_s - self.suspects[0].after_s, 2)

    @property
    def limit_s(self) -> float:
        """Within which the cause is to be named."""
        stalls = any(made.strike.stalls for made in self.suspects)
        return self.slowed * (STALLED_NAMED_S if stalls else NAMED_S)

    @property
    def late(self) -> bool:
        """Whether the cause was named too late."""
        return self.named_after_s is not None and self.named_after_s > self.limit_s

    @property
    def unnamed(self) -> bool:
        """Whether it failed without a word, though it could write and was not itself ended."""
        asked = any(made.phase in ("loading", "end") for made in self._at_runner)
        mute = any(made.strike.target == OUTPUT for made in self.made)
        failed = bool(self.made and self.status and not self.cause)
        return failed and not (asked or mute or self.is_forced)

    @property
    def is_forced(self) -> bool:
        """Whether the runner itself was struck so that it ends without clean-up."""
        return len(self._at_runner) > 1 or any(made.strike.ends for made in self._at_runner)

    @property
    def _at_runner(self) -> list[Made]:
        return [made for made in self.made if made.strike.target == RUNNER]


def from_fields(fields: dict[str, Any]) -> Outcome:
    """Return an outcome from what dataclasses.asdict says of it."""
    moment, made = fields.pop("moment"), fields.pop("made")
    strikes = [Made(**each | {"strike": Strike(**each["strike"])}) for each in made]
    return Outcome(moment=Moment(**moment), made=strikes, **fields)


def first_report(text: Iterable[tuple[float, str]], cause: str, ended: float) -> float:
    """Return when a run has first named the cause of its end, or of the loss of its light.

    It goes on for a while, and ends if its light is not back. So does a tunnel without keys.
    """
    report = ((at, reason) for at, line in text if (reason := _reason(line)))
    return min((at for at, reason in report if reason in cause), default=ended)


def _reason(line: str) -> str:
    """Return why there is no light, or why a session for keys has failed, if a line says it."""
    failed = FAILED.search(line)
    return failed[1] if failed else line.removeprefix(NO_LIGHT) if line.startswith(NO_LIGHT) else ""


def bad(outcome: Outcome) -> bool:
    """Whether something went wrong that must not, whatever was struck."""
    hangs, wrong = outcome.status is None, bool(outcome.faults or outcome.leftovers)
    return hangs or wrong or outcome.late or outcome.unnamed or outcome.blames_another


def too_few(made: int, wanted: int | None, minutes: float) -> str:
    """Return in words that fewer strikes were made than were asked for, "" if it is not so."""
    if wanted is None or made >= wanted:
        return ""
    return (
        f"too few          {made} of {wanted} strikes in {minutes:g} minutes: allow more --minutes"
    )


def describe(outcome: Outcome) -> str:
    """Return the strikes at one run in one line."""
    what = " + ".join(f"{made.strike.how} to {made.strike.target}" for made in outcome.made)
    end = "HANGS" if outcome.status is None else f"status {outcome.status}"
    cause = f"; {outcome.named_after_s} s: {outcome.cause[:110]}" if outcome.cause else ""
    late = f"; LATE: after {outcome.limit_s:.1f} s" if outcome.late else ""
    late += "; NO CAUSE NAMED" if outcome.unnamed else ""
    late += "; ANOTHER NAMED" if outcome.blames_another else ""
    wrong = "".join(f"; WRONG: {fault}" for fault in (*outcome.faults, *outcome.leftovers))
    if (outcome.status and not outcome.cause) or bad(outcome):
        wrong += f"; output: {' | '.join(outcome.last_words)}"
    when = f"{outcome.moment.phase} {outcome.moment.share:.2f}"
    head = f"{outcome.number:4} {outcome.job:10} {when:12} {what or 'nothing (it had ended)':28}"
    return f"{head} {end}{cause}{late}{wrong}"


def summary(outcomes: list[Outcome]) -> str:
    """Return the counts."""
    made = [made for outcome in outcomes for made in outcome.made]
    failed = [outcome for outcome in outcomes if outcome.cause]
    timed = sorted(outcome.named_after_s or 0.0 for outcome in failed)
    other = [outcome for outcome in failed if outcome.blames_another]
    phases = ", ".join(f"{name} {sum(each.phase == name for each in made)}" for name in PHASES)
    lines = [
        f"strikes          {len(made)} in {len(outcomes)} runs: {phases}",
        f"hangs            {sum(outcome.status is None for outcome in outcomes)}",
        f"wrong bytes      {sum(bool(outcome.faults) for outcome in outcomes)}",
        f"leftovers, harm  {sum(bool(outcome.leftovers) for outcome in outcomes)}",
        f"cause named      in {len(failed)} runs; late in {sum(o.late for o in failed)}",
        f"no cause named   in {sum(outcome.unnamed for outcome in outcomes)} runs that failed",
        f"another named    {len(other)}",
        f"slowed by others {max((o.slowed for o in outcomes), default=1):g} times at most",
        *(f"                 {describe(outcome)}" for outcome in other),
    ]
    if timed:
        middle, last = timed[len(timed) // 2], timed[-1]
        within = sum(each <= NAMED_S for each in timed)
        lines.append(
            f"time to cause    p50 {middle:.2f} s, longest {last:.2f} s, by the wall's clock"
        )
        lines.append(
            f"                 within {NAMED_S:g} s of it in {within} of {len(timed)} runs"
        )
    return "\n".join(lines)
