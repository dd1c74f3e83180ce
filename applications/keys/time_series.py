"""The time series of a run with key managers or tunnels, in seconds since the run could begin."""

import math
from collections.abc import Callable, Iterable, Mapping
from operator import itemgetter
from typing import Any

from qmn.jobs.transfer import Lines
from topologies.system.processes.programs import Program
from wire.network_time import NEVER, NetworkTime
from wire.results.figures import StoredKeyFigures
from wire.results.time_series import AnyMoment, Moment, SessionMoment, moment

NOT_AHEAD: Mapping[str, float] = {}


class TimeSeries:
    """Gathers the lines of programs, and what the run itself does."""

    def __init__(
        self,
        programs: Mapping[str, Program],
        network_time: NetworkTime,
        tell: Callable[[Moment], None],
        ahead_s: Mapping[str, float] = NOT_AHEAD,
    ) -> None:
        """Read the output of these programs from now on; call `tell` with each moment.

        `ahead_s` says how far the clocks of hosts are ahead of this machine's, where they are.
        """
        self._ahead_s = ahead_s
        self._lines = [(host, Lines(program)) for host, program in programs.items()]
        self._time, self._since_ns, self._tell = network_time, network_time.stamp_ns(), tell
        self.all: list[AnyMoment] = []

    @property
    def now_s(self) -> float:
        """How long ago the run began, in seconds of the network."""
        return self._time.network_s((self._time.stamp_ns() - self._since_ns) / 1e9)

    def stepped_ns(self, seconds: float) -> int:
        """Return the end of a number of seconds, on the clock of stepped time."""
        return NEVER if seconds == math.inf else self._since_ns + round(1e9 * seconds)

    def listen(self, host: str, program: Program) -> None:
        """Read what another program says, too."""
        self._lines.append((host, Lines(program)))

    def add(self, event: str, **fields: Any) -> None:
        self._note(moment({"event": event, **fields}, self.now_s))

    def gather(self) -> None:
        """Note the output since the last time, in the order of its times."""
        lines = [
            {**line, "host": host, "at": float(line["at"]) - self._ahead_s.get(host, 0.0)}
            for host, lines in self._lines
            for line in lines.new()
            if "event" in line and "at" in line
        ]
        for line in sorted(lines, key=itemgetter("at")):
            since_s = line["at"] - self._since_ns / 1e9
            self._note(moment(line, self._time.network_s(since_s)))

    def finish(self) -> None:
        """Gather what is left, and put all into the order of its times."""
        self.gather()
        self.all.sort(key=lambda each: each.at)

    def _note(self, happened: AnyMoment) -> None:
        self.all.append(happened)
        self._tell(happened)


def sessions(series: Iterable[Moment]) -> list[SessionMoment]:
    return [each for each in series if isinstance(each, SessionMoment) and each.opened]


def summary(series: Iterable[Moment], elapsed_s: float) -> StoredKeyFigures:
    """Return the numbers of a run that has made keys."""
    held = sessions(series)
    rates = [each.qber for each in held if each.qber is not None]
    keys = sum(each.keys for each in held)
    return StoredKeyFigures(
        sessions=len(held),
        sessions_without_key=sum(1 for each in held if each.keys == 0),
        keys=keys,
        qber_lowest=min(rates, default=None),
        qber_highest=max(rates, default=None),
        elapsed_s=elapsed_s,
        keys_per_s=keys / elapsed_s if elapsed_s else 0.0,
    )


def words(happened: Moment) -> str:
    host = f"{happened.host}: " if happened.host else ""
    shown = {"at", "host", "event", "text", "opened", "withheld"}
    rest = ", ".join(
        f"{name.replace('_', ' ')} {_text(value)}"
        for name, value in vars(happened).items()
        if name not in shown and value is not None
    )
    why = getattr(happened, "text", "")
    text = f"{host}{happened.event.replace('_', ' ')}{': ' if rest else ''}{rest}"
    return f"{happened.at:8.2f} s  {text}{f' ({why})' if why else ''}"


def _text(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)
