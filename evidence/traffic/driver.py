"""The driver of heavy traffic: every planned session at its time, none forgotten."""

import asyncio
from collections.abc import Callable, Mapping, Sequence
from random import Random

from evidence.traffic.plan import Planned
from evidence.traffic.session import NO_IDLE_HOST, Outcome, SessionRun, Wanted
from hosts.network_loop import now_s, wall_sleep
from qmn.timeouts import LOAD_CHECK_S
from wire.network_time import NetworkTime
from wire.results.run_result import BLOCKED

FIRST_PORT = 10_000
PORTS = 50_000


class Driver:
    """Sessions that are asked for one after the other, as many at a time as there are."""

    def __init__(
        self,
        plan: Sequence[Planned],
        wanted: Wanted,
        stacks: Mapping[str, str],
        groups: tuple[Sequence[str], Sequence[str]],
        seed: int,
        time: NetworkTime,
    ) -> None:
        """`stacks` are the sockets of the hosts; `groups` the openers and acceptors there are."""
        self._plan, self._wanted, self._stacks = plan, wanted, stacks
        self._groups, self._random, self._time = groups, Random(seed), time  # noqa: S311
        self._busy: set[str] = set()
        self.outcomes: list[Outcome] = []
        self.began_ns = 0  # on the clock of events

    @property
    def under_way(self) -> int:
        """How many sessions have begun and not ended."""
        return sum(not outcome.outcome for outcome in self.outcomes)

    async def run(self, check: Callable[[], None]) -> None:
        """Drive all sessions to their ends, on a loop of the network's time.

        `check` is called meanwhile, and may raise.
        """
        checking = asyncio.create_task(_checking(check))
        driving = asyncio.create_task(self._all())
        try:
            await asyncio.wait([checking, driving], return_when=asyncio.FIRST_COMPLETED)
            if checking.done():
                await checking
            await driving
        finally:
            for task in (checking, driving):
                task.cancel()
            await asyncio.gather(checking, driving, return_exceptions=True)

    async def _all(self) -> None:
        began_s, self.began_ns = now_s(), self._time.stamp_ns()
        async with asyncio.TaskGroup() as group:
            for number, planned in enumerate(self._plan):
                await asyncio.sleep(began_s + planned.at_s - now_s())
                group.create_task(self._one(number, planned, began_s))

    async def _one(self, number: int, planned: Planned, began_s: float) -> None:
        ends = self._ends(planned)
        opener, acceptor, *others = ends or ("", "")
        outcome = Outcome(planned, opener, acceptor, now_s() - began_s, others=tuple(others))
        self.outcomes.append(outcome)
        if ends is None:
            outcome.outcome, outcome.reason = BLOCKED, NO_IDLE_HOST
        else:
            self._busy.update(ends)
            port = FIRST_PORT + number % PORTS
            await SessionRun(outcome, self._wanted, self._stacks, port).run()
            self._busy.difference_update(ends)
        outcome.ended_s = now_s() - began_s

    def _ends(self, planned: Planned) -> Sequence[str] | None:
        """Return who takes part: as planned, or hosts that are idle now; None if too few are."""
        if planned.opener:
            return planned.opener, planned.acceptor, *planned.others
        ends: list[str] = []
        openers, acceptors = self._groups
        for group in (openers, *(self._wanted.hosts - 1) * [acceptors]):
            idle = [host for host in group if host not in self._busy and host not in ends]
            if not idle:
                return None
            ends.append(self._random.choice(idle))
        return ends


async def _checking(check: Callable[[], None]) -> None:
    while True:
        check()
        await wall_sleep(LOAD_CHECK_S)
