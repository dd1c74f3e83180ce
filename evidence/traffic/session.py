"""One session of the traffic, from its request to its end, as its hosts see it."""

import asyncio
from collections.abc import Awaitable, Mapping, Sequence
from contextlib import AbstractAsyncContextManager
from dataclasses import dataclass, field
from typing import Any

from evidence.traffic.plan import Planned
from hosts.client import Session, session
from hosts.network_loop import now_s
from hosts.stack_socket import QuantumSocketError
from qmn.timeouts import LOAD_LIMIT_S
from wire.metadata.vocabulary import Reason, Service
from wire.results.run_result import ACCEPTED, BLOCKED, BROKEN, LATE
from wire.services import LINES

NO_IDLE_HOST, NO_END = "NO_IDLE_HOST", "NO_END"  # reasons of our own
PAIR = 2  # hosts of most services
BASES = ("X", "Y", "Z")
AGREE = {"X": True, "Y": False, "Z": True}  # whether both halves of Phi+ tell the same


@dataclass
class Outcome:
    """The outcome of a session; times are seconds of the network from the beginning."""

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
    service: Service
    options: Mapping[str, Any]  # of the service's session
    data: bytes = b""  # to send, of a service that carries bytes
    own_source: bool = False  # whether the opener makes the pairs
    measures: bool = False  # whether pairs are measured at the end of the holding time
    hosts: int = PAIR  # that take part
    goes_back_on: Service | None = None  # of which the acceptor opens a session before
    swaps: Mapping[tuple[str, str], int] = field(default_factory=dict)  # by opener and acceptor


class SessionRun:
    def __init__(
        self, outcome: Outcome, wanted: Wanted, stacks: Mapping[str, str], port: int
    ) -> None:
        self._outcome, self._wanted = outcome, wanted
        self._stacks, self._port = stacks, port
        self._began_s = now_s()

    async def run(self) -> None:
        """Ask, hold, end; the outcome says how that went, whatever it was."""
        outcome = self._outcome
        try:
            async with asyncio.timeout(outcome.planned.holding_s + LOAD_LIMIT_S):
                await self._take_part()
            outcome.outcome = ACCEPTED
        except QuantumSocketError as error:
            outcome.outcome = BLOCKED if outcome.setup_s is None else BROKEN
            if error.reason == Reason.TOO_LATE:
                outcome.outcome = LATE
            outcome.reason, outcome.text = error.reason.name, str(error)
        except _TooLateError:
            outcome.outcome, outcome.reason = LATE, "DEADLINE"
        except TimeoutError:
            outcome.outcome, outcome.reason = BROKEN, NO_END

    async def _take_part(self) -> None:
        held_service, outcome = self._wanted.goes_back_on, self._outcome
        if held_service is None:
            await self._itself()
            return
        async with self._session(held_service, (outcome.acceptor, outcome.opener)) as held:
            await self._by_deadline(anext(held.opener.results(), None))
            await self._itself()
            await held.end()

    async def _itself(self) -> None:
        outcome = self._outcome
        hosts = outcome.opener, outcome.acceptor, *outcome.others
        async with self._session(self._wanted.service, hosts) as running:
            await self._use(running)

    def _session(
        self, service: Service, hosts: Sequence[str]
    ) -> AbstractAsyncContextManager[Session]:
        wanted, outcome = self._wanted, self._outcome
        options = {**wanted.options, "priority": outcome.planned.priority}
        if outcome.planned.deadline_s is not None:
            options["deadline_ms"] = max(round(outcome.planned.deadline_s * 1000), 1)
        if wanted.own_source:
            options["source"] = outcome.opener
        if service == Service.SWAP:
            options["swaps"] = wanted.swaps[outcome.opener, outcome.acceptor]
        if service in LINES:
            options["line"] = ",".join(hosts)
        stacks, name = self._stacks.__getitem__, service.name.lower()
        return session(stacks, name, hosts, self._port, limit_s=None, **options)

    async def _by_deadline(self, result: Awaitable[object]) -> None:
        """Wait for the first result; raise _TooLateError if it misses the deadline."""
        deadline_s = self._outcome.planned.deadline_s
        left_s = None if deadline_s is None else deadline_s - self._since()
        try:
            async with asyncio.timeout(left_s) as deadline:
                await result
        except TimeoutError:
            if deadline.expired():
                raise _TooLateError from None
            raise

    async def _use(self, running: Session) -> None:
        outcome, wanted = self._outcome, self._wanted
        opener, results = running.opener, running.opener.results()
        await self._by_deadline(anext(results, None))
        outcome.setup_s = self._since()
        async for _result in results:
            continue
        if not opener.over:
            await opener.sendall(wanted.data)
            there_s = now_s()
            await asyncio.sleep(outcome.planned.holding_s)
            if wanted.measures:
                await running.heard()
                outcome.age_s = now_s() - there_s
                await _measure(outcome, running, int(opener.summary["pairs"]))
        await running.end()
        outcome.summary = opener.summary

    def _since(self) -> float:
        return now_s() - self._began_s


class _TooLateError(Exception):
    """The session has no light by its deadline."""


async def _measure(outcome: Outcome, pairs: Session, count: int) -> None:
    """Measure all pairs at both ends, a third of them in each basis; count those as Phi+ has."""
    for place, basis in enumerate(BASES):
        numbers = list(range(place, count, len(BASES)))
        if numbers:
            answers = await pairs.ask(measure=numbers, basis=basis)
            outcome.right[basis], outcome.measured[basis] = like_phi_plus(answers, basis)


def like_phi_plus(answers: Sequence[Mapping[str, Any]], basis: str) -> tuple[int, int]:
    """Return how many outcomes of two hosts are as Phi+ has them, and how many both have."""
    one, other = (answer["outcomes"] for answer in answers)
    seen = [pair for pair in zip(one, other, strict=True) if None not in pair]
    return sum((a == b) == AGREE[basis] for a, b in seen), len(seen)
