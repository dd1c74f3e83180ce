"""The driver of heavy traffic: every planned session at its time, none forgotten."""

import asyncio
import time
from collections.abc import Callable, Mapping, Sequence
from random import Random

from evidence.traffic.plan import Planned
from evidence.traffic.session import NO_IDLE_HOST, Outcome, SessionRun, Wanted
from qmn.timeouts import LOAD_CHECK_S
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
        scale: float,
    ) -> None:
        """`stacks` are the sockets of the hosts; `groups` the openers and acceptors there are."""
        self._plan, self._wanted, self._stacks = plan, wanted, stacks
        self._groups, self._random, self._scale = groups, Random(seed), scale  # noqa: S311
        self._busy: set[str] = set()
        self.outcomes: list[Outcome] = []
        self.began_ns = 0  # on the clock of the captures

    @property
    def under_way(self) -> int:
        """How many sessions have begun and not ended."""
        return sum(not each.outcome for each in self.outcomes)

    async def run(self, check: Callable[[], None]) -> None:
        """Drive all sessions to their ends; `check` is called meanwhile, and may raise."""
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
        loop = asyncio.get_running_loop()
        began, self.began_ns = loop.time(), time.time_ns()
        async with asyncio.TaskGroup() as group:
            for number, planned in enumerate(self._plan):
                await asyncio.sleep(began + planned.at_s * self._scale - loop.time())
                group.create_task(self._one(number, planned, began))

    async def _one(self, number: int, planned: Planned, began: float) -> None:
        loop = asyncio.get_running_loop()

        def now_s() -> float:
            return (loop.time() - began) / self._scale

        ends = self._ends(planned)
        opener, acceptor, *others = ends or ("", "")
        outcome = Outcome(planned, opener, acceptor, now_s(), others=tuple(others))
        self.outcomes.append(outcome)
        if ends is None:
            outcome.outcome, outcome.reason = BLOCKED, NO_IDLE_HOST
        else:
            self._busy.update(ends)
            port = FIRST_PORT + number % PORTS
            await SessionRun(outcome, self._wanted, self._stacks, port, self._scale).run()
            self._busy.difference_update(ends)
        outcome.ended_s = now_s()

    def _ends(self, planned: Planned) -> Sequence[str] | None:
        """Return who takes part: as planned, or hosts that are idle now; None if too few are."""
        if planned.opener:
            return planned.opener, planned.acceptor, *planned.others
        found: list[str] = []
        openers, acceptors = self._groups
        for group in (openers, *(self._wanted.hosts - 1) * [acceptors]):
            idle = [host for host in group if host not in self._busy and host not in found]
            if not idle:
                return None
            found.append(self._random.choice(idle))
        return found


async def _checking(check: Callable[[], None]) -> None:
    while True:
        check()
        await asyncio.sleep(LOAD_CHECK_S)
