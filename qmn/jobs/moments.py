"""The words of key managers and tunnels on one time line: seconds since the run could begin."""

import time
from collections.abc import Callable, Iterable, Mapping
from typing import Any

from qmn.jobs.transfer import Lines
from topologies.system.processes.programs import Program
from wire.network_time import NetworkTime
from wire.results.figures import StoredKeyFigures
from wire.results.run_result import Moment as Moment


class Moments:
    """Gathers the lines of programs, and what the run itself does."""

    def __init__(
        self,
        programs: Mapping[str, Program],
        network_time: NetworkTime,
        tell: Callable[[Moment], None],
    ) -> None:
        """Read what these programs of hosts say from now on; `tell` is told each moment."""
        self._lines = [(host, Lines(program)) for host, program in programs.items()]
        self._scale, self._since_s, self._tell = network_time.scale, time.time(), tell
        self.all: list[Moment] = []

    @property
    def now_s(self) -> float:
        """How long ago the run began, in seconds of the network."""
        return (time.time() - self._since_s) / self._scale

    def listen(self, host: str, program: Program) -> None:
        """Read what another program says, too."""
        self._lines.append((host, Lines(program)))

    def add(self, event: str, **fields: Any) -> None:
        """Note what the run does now."""
        self._note({"at": self.now_s, "event": event, **fields})

    def gather(self) -> None:
        """Note what the programs have said since the last time, in the order of its times."""
        said = [
            {**fields, "host": host, "at": (fields["at"] - self._since_s) / self._scale}
            for host, lines in self._lines
            for fields in lines.new()
            if "event" in fields and "at" in fields
        ]
        for moment in sorted(said, key=lambda each: each["at"]):
            self._note(moment)

    def finish(self) -> None:
        """Gather what is left, and put all into the order of its times."""
        self.gather()
        self.all.sort(key=lambda moment: float(moment["at"]))

    def _note(self, moment: Moment) -> None:
        self.all.append({**moment, "at": round(moment["at"], 3)})
        self._tell(moment)


def sessions(moments: Iterable[Moment]) -> list[Moment]:
    """Return what became of sessions, as those who opened them have said."""
    return [each for each in moments if each.get("opened")]


def summary(moments: Iterable[Moment], elapsed_s: float) -> StoredKeyFigures:
    """Return the numbers of a run that has made keys."""
    held = sessions(moments)
    rates = [each["qber"] for each in held if each["qber"] is not None]
    keys = sum(each["keys"] for each in held)
    return StoredKeyFigures(
        sessions=len(held),
        sessions_without_key=sum(1 for each in held if each["keys"] == 0),
        keys=keys,
        qber_lowest=min(rates, default=None),
        qber_highest=max(rates, default=None),
        elapsed_s=elapsed_s,
        keys_per_s=keys / elapsed_s if elapsed_s else 0.0,
    )


def words(moment: Moment) -> str:
    """Return a moment as people read it."""
    host = f"{moment['host']}: " if "host" in moment else ""
    known = {"at", "host", "event", "text", "opened", "withheld"}
    rest = ", ".join(
        f"{name.replace('_', ' ')} {_text(value)}"
        for name, value in moment.items()
        if name not in known and value is not None
    )
    text = f" ({moment['text']})" if moment.get("text") else ""
    said = f"{host}{moment['event'].replace('_', ' ')}"
    return f"{moment['at']:8.2f} s  {said}{': ' if rest else ''}{rest}{text}"


def _text(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)
