"""The words of a run's applications, followed from their first line to their last."""

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

from qmn.jobs.obstacle import obstacle
from qmn.timeouts import STALL_TIMEOUT_S
from topologies.networks.network import Network
from topologies.system.processes.programs import NetworkError, Program
from topologies.timeouts import POLL_S
from wire.controller_lines import read_record
from wire.metadata.vocabulary import Reason
from wire.network_time import NetworkTime
from wire.results.time_series import Line, fields_of

OUTCOMES = (Reason.TOO_NOISY.name,)  # of sessions that have ended as they should


class TransferError(Exception):
    """The message did not arrive, or the service failed; the text says why and what to do."""

    def __init__(self, text: str, reason: str = "") -> None:
        """`reason` is the name of that of the session, if it gave one."""
        super().__init__(text)
        self.reason = reason

    @property
    def is_outcome(self) -> bool:
        return self.reason in OUTCOMES


class Lines:
    """The lines of JSON that a program prints, read as they come."""

    def __init__(self, program: Program) -> None:
        self.program, self._position = program, 0

    def new(self) -> list[Line]:
        """Return what each new line says; a line that is not an object of JSON says nothing."""
        with self.program.log.open("rb") as log:
            log.seek(self._position)
            text = log.read().decode(errors="replace")
        complete = text[: text.rfind("\n") + 1]
        self._position += len(complete.encode())
        return [fields_of(line) for line in complete.splitlines()]


class Patience:
    """How long programs may be silent: for some seconds of the network.

    Where time is stepped that is until its clock has come so far, or stands.
    """

    def __init__(self, clock: NetworkTime, limit_s: float) -> None:
        self._clock, self._limit_s = clock, limit_s
        self.wall_s = clock.wall_s(limit_s)
        self.renew()

    def renew(self) -> None:
        self._heard_s = self._stepped_s = time.monotonic()
        self._heard_network_s = self._seen_s = self._clock.now_s()

    @property
    def is_over(self) -> bool:
        now_s, network_s = time.monotonic(), self._clock.now_s()
        if network_s != self._seen_s:
            self._seen_s, self._stepped_s = network_s, now_s
        waited = network_s - self._heard_network_s > self._limit_s
        stands = now_s - self._stepped_s > self.wall_s
        return now_s - self._heard_s > self.wall_s and (waited or stands)


def follow(
    network: Network,
    program: Program,
    progress: Callable[[Line], None],
    look: Callable[[], None],
) -> Line:
    """Read a program's lines of JSON until its last; every wait here has a deadline."""
    last = follow_all(network, [program], lambda _program, fields: progress(fields), look)
    return last[program.name]


def follow_all(
    network: Network,
    programs: Sequence[Program],
    progress: Callable[[Program, Line], None],
    look: Callable[[], None],
    stall_s: float = STALL_TIMEOUT_S,
) -> dict[str, Line]:
    """Read what programs say until the last line of each; return these by the programs' names.

    In `stall_s` seconds of the network at least one of them must say something. `look` is called
    again and again meanwhile.
    """
    patience = Patience(network.runtime.time, stall_s)
    going = {program.name: Lines(program) for program in programs}
    last: dict[str, Line] = {}
    latest: dict[str, Line] = {}
    while going:
        for name, lines in list(going.items()):
            ended = not lines.program.running  # asked first, so that no line after it is missed
            for fields in until_done(network, lines):
                patience.renew()
                if fields.get("event") == "done":
                    last[name] = fields
                elif fields:
                    latest[name] = fields
                    progress(lines.program, fields)
            if name in last:
                del going[name]
            elif ended:
                network.check()
                raise TransferError(f"{name} ended: {lines.program.end()}")
        network.check()
        look()
        if going and patience.is_over:
            silent = {name: latest.get(name) for name in going}
            raise NetworkError(no_progress(silent, patience.wall_s))
        if going:
            time.sleep(POLL_S)
    return last


def until_done(network: Network, lines: Lines) -> Iterator[Line]:
    """Yield a program's new lines, to its last; raise TransferError if it has failed."""
    for fields in lines.new():
        if fields.get("event") == "failed":
            text = with_elements(network, str(fields["text"]))
            raise TransferError(text, str(fields.get("reason", "")))
        yield fields
        if fields.get("event") == "done":
            return


def no_progress(latest: Mapping[str, Mapping[str, Any] | None], limit_s: float) -> str:
    """Return why a run of silent programs ends, by the last report of each.

    Only they know whether light was lost: who has lost none may be short of anything else.
    """
    text = f"{', '.join(latest)} made no progress for {limit_s:g} s"
    for fields in latest.values():
        if fields and fields.get("lost_pairs"):
            pairs = f"{fields['lost_pairs']:,} of {fields.get('bell_pairs', 0):,} pairs"
            return f"{text}; {pairs} were lost: is the loss of the fibres too high?"
    heard = [f"{name}: {last_word(fields)}" for name, fields in latest.items()]
    return f"{text}; no host reported lost light; last reports: {', '.join(heard)}"


def last_word(fields: Mapping[str, Any] | None) -> str:
    if not fields:
        return "nothing yet"
    event = str(fields.get("event", "a line"))
    counts = [f"{name} {value:,}" for name, value in fields.items() if type(value) is int]
    return f"{event} ({', '.join(counts[:3])})" if counts else event


def with_elements(network: Network, text: str) -> str:
    """Return what an application says, with what the controller found in the way of light.

    A policy may keep it from hosts, and a host whose light goes out does not hear why.
    """
    elements = obstacle(read_record(network.runtime.logs))
    return text if elements in text else f"{text}: {elements}"
