"""One session of the traffic, from its request to its end, as its hosts see it."""

import asyncio
from collections.abc import AsyncIterator, Mapping, Sequence
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import dataclass, field
from typing import Any

from evidence.traffic.plan import Planned
from evidence.traffic.stack_calls import Refused, StackCalls, calls
from hosts.network_loop import now_s
from qmn.timeouts import LOAD_LIMIT_S
from wire.metadata.vocabulary import Reason, Service
from wire.results.run_result import ACCEPTED, BLOCKED, BROKEN, LATE
from wire.services import LINES
from wire.socket_calls import Call

NO_IDLE_HOST, NO_END = (
    "NO_IDLE_HOST",
    "NO_END",
)  # reasons of our own
PAIR = 2  # hosts of most services
BASES = ("X", "Y", "Z")
AGREE = {"X": True, "Y": False, "Z": True}  # whether both halves of Phi+ tell the same


@dataclass
class Outcome:
    """What has become of a session; times are seconds of the network from the beginning."""

    planned: Planned
    opener: str
    acceptor: str
    asked_s: float
    outcome: str = ""
    reason: str = ""  # of what is not accepted
    text: str = ""
    setup_s: float | None = None  # from the request until the opener could use its light
    ended_s: float = 0.0
    age_s: float = 0.0  # of what it was given, when it was measured
    right: dict[str, int] = field(default_factory=dict)  # outcomes as Phi+ has them, by basis
    measured: dict[str, int] = field(default_factory=dict)
    summary: dict[str, Any] = field(default_factory=dict)
    others: tuple[str, ...] = ()  # further hosts


@dataclass(frozen=True)
class Wanted:
    """What every session asks for."""

    service: Service
    options: Mapping[str, Any]  # of the service's session
    data: bytes = b""  # to send, of a service that carries bytes
    own_source: bool = False  # whether the opener makes the pairs
    measures: bool = False  # whether pairs are measured at the end of the holding time
    hosts: int = PAIR  # that take part
    goes_back_on: Service | None = None  # of which the acceptor opens a session before


Hearing = asyncio.Task[StackCalls]  # what a host that is asked hears


class SessionRun:
    """A session that is under way."""

    def __init__(
        self, outcome: Outcome, wanted: Wanted, stacks: Mapping[str, str], port: int
    ) -> None:
        self._outcome, self._wanted = outcome, wanted
        self._stacks, self._port = stacks, port
        self._began_s = now_s()

    async def run(self) -> None:
        """Ask, hold, end; the outcome says how that went, whatever it was."""
        planned, told = self._outcome.planned, self._outcome
        try:
            async with asyncio.timeout(planned.holding_s + LOAD_LIMIT_S):
                await self._take_part()
            told.outcome = ACCEPTED
        except Refused as error:
            told.outcome = BLOCKED if told.setup_s is None else BROKEN
            if error.reason == Reason.TOO_LATE.name:
                told.outcome = LATE
            told.reason, told.text = error.reason, str(error)
        except _TooLateError:
            told.outcome, told.reason = LATE, "DEADLINE"
        except TimeoutError:
            told.outcome, told.reason = BROKEN, NO_END

    async def _take_part(self) -> None:
        standing, told = self._wanted.goes_back_on, self._outcome
        if standing is None:
            await self._itself()
            return
        async with self._asked(standing, (told.acceptor, told.opener)) as (asking, hearing):
            await self._by_deadline(asking)
            await self._itself()
            asking.say(Call.CLOSE)
            await _over(asking, hearing)

    async def _itself(self) -> None:
        told = self._outcome
        hosts = told.opener, told.acceptor, *told.others
        async with self._asked(self._wanted.service, hosts) as (asking, hearing):
            await self._use(asking, hearing)

    @asynccontextmanager
    async def _asked(
        self, service: Service, hosts: Sequence[str]
    ) -> AsyncIterator[tuple[StackCalls, list[Hearing]]]:
        """Let the first of the hosts ask; give what it hears, and what the others will hear."""
        wanted, told, name = self._wanted, self._outcome, service.name.lower()
        async with AsyncExitStack() as stack:
            waiting = []
            for host in hosts[1:]:
                listener = await stack.enter_async_context(calls(self._stacks[host]))
                listener.say(Call.LISTEN, port=self._port, service=name)
                await listener.read()
                asked = await stack.enter_async_context(calls(self._stacks[host]))
                asked.say(Call.ACCEPT, port=self._port)
                waiting.append(asked)
            asking = await stack.enter_async_context(calls(self._stacks[hosts[0]]))
            options = dict(wanted.options)
            options |= {"priority": told.planned.priority}
            if told.planned.deadline_s is not None:
                options |= {"deadline_ms": max(round(told.planned.deadline_s * 1000), 1)}
            if wanted.own_source:
                options["source"] = told.opener
            if service in LINES:
                options["line"] = ",".join(hosts)
            where = {"service": name, "host": hosts[1], "port": self._port}
            asking.say(Call.REQUEST, **where, **options)
            hearing = [asyncio.create_task(_there(each)) for each in waiting]
            try:
                yield asking, hearing
            finally:
                for each in hearing:
                    each.cancel()
                await asyncio.gather(*hearing, return_exceptions=True)

    async def _by_deadline(self, asking: StackCalls) -> tuple[Call, dict[str, Any]]:
        """Return what comes of the request; raise _TooLateError unless it does by the deadline."""
        deadline_s = self._outcome.planned.deadline_s
        left_s = None if deadline_s is None else deadline_s - self._since()
        try:
            async with asyncio.timeout(left_s) as deadline:
                return await asking.read()
        except TimeoutError:
            if deadline.expired():
                raise _TooLateError from None
            raise

    async def _use(self, asking: StackCalls, hearing: list[Hearing]) -> None:
        planned, told, wanted = self._outcome.planned, self._outcome, self._wanted
        call, fields = await self._by_deadline(asking)
        told.setup_s = self._since()
        while call == Call.RESULT:
            call, fields = await asking.read()
        if call == Call.CLOSE:
            told.summary = fields
            await asyncio.gather(*hearing)
            return
        if wanted.data:
            asking.send(wanted.data)
            call, fields = await asking.read()
        there_s = now_s()
        await asyncio.sleep(planned.holding_s)
        if wanted.measures:
            both = asking, await hearing[0]
            told.age_s = now_s() - there_s
            await _measure(told, both, int(fields["pairs"]))
        asking.say(Call.CLOSE)
        told.summary = await _over(asking, hearing)

    def _since(self) -> float:
        return now_s() - self._began_s


class _TooLateError(Exception):
    """The session has no light by its deadline."""


async def _there(asked: StackCalls) -> StackCalls:
    """Read what a host that is asked is told; return when it may ask, or all is over."""
    await asked.read()
    call = Call.RESULT
    while call not in (Call.DONE, Call.CLOSE):
        call, _fields = await asked.read()
    return asked


async def _over(asking: StackCalls, hearing: list[Hearing]) -> dict[str, Any]:
    """Wait until a session is over at its hosts; return the opener's summary."""
    call, fields = Call.RESULT, dict[str, Any]()
    while call != Call.CLOSE:
        call, fields = await asking.read()
    await asyncio.gather(*hearing)
    return fields


async def _measure(told: Outcome, both: tuple[StackCalls, StackCalls], pairs: int) -> None:
    """Measure all pairs at both ends, a third of them in each basis; count those as Phi+ has."""
    for place, basis in enumerate(BASES):
        numbers = list(range(place, pairs, len(BASES)))
        if not numbers:
            continue
        ours, theirs = await asyncio.gather(
            *(end.ask(measure=numbers, basis=basis) for end in both)
        )
        seen = [
            (one, other)
            for one, other in zip(ours["outcomes"], theirs["outcomes"], strict=True)
            if None not in (one, other)
        ]
        told.measured[basis] = len(seen)
        told.right[basis] = sum((one == other) == AGREE[basis] for one, other in seen)
