"""The carrying out of what protocols order: everything that waits for hardware, clocks and threads.

Who has a connection, too, carries out what is said and heard on it (ends.py).
"""

import asyncio
from collections.abc import Callable, Coroutine
from contextlib import suppress
from dataclasses import dataclass, field
from math import inf
from typing import Any, TypeVar, cast

from hosts.hardware.operations import BlockName
from hosts.hardware.qnic import Qnic
from hosts.hardware.replies import HardwareError, NoLight
from hosts.middleware.session import protocol
from hosts.middleware.session.errors import SessionError
from hosts.middleware.session.protocol import Order, Steps
from hosts.network_loop import now_s

T = TypeVar("T")


@dataclass(frozen=True)
class Expected:
    """Light under way."""

    coming: asyncio.Task[Any]
    blocks: tuple[BlockName, ...]

    def cancel(self) -> None:
        """Expect it no longer; nobody hears what has come of it."""
        if not self.coming.cancel() and not self.coming.cancelled():
            self.coming.exception()


@dataclass
class Performer:
    """A host's hardware, at the orders of protocols."""

    qnic: Qnic
    _beside: asyncio.TaskGroup | None = field(default=None, init=False, repr=False)
    _going: list[asyncio.Task[None]] = field(default_factory=list, init=False, repr=False)
    # What steps wait for that others bring about, and who waits.
    _waiting: list[tuple[Callable[[], Any], asyncio.Future[None]]] = field(
        default_factory=list, init=False, repr=False
    )

    async def perform_together(self, steps: Steps[T]) -> T:
        """Carry out steps, and those that they order beside them; the first failure ends all."""
        try:
            async with asyncio.TaskGroup() as self._beside:
                outcome = await self.perform(steps)
                for task in self._going:
                    task.cancel()
                return outcome
        except BaseExceptionGroup as failures:
            raise failures.exceptions[0] from failures
        finally:
            self._beside = None

    async def perform(self, steps: Steps[T]) -> T:
        """Carry out what a protocol orders, one order after the other; return what it does.

        Light that it has begun to expect and has not collected is not expected any more then.
        """
        lights: list[Expected] = []
        outcome: Any = None
        failure: SessionError | HardwareError | None = None
        try:
            while True:
                try:
                    order = steps.send(outcome) if failure is None else steps.throw(failure)
                except StopIteration as end:
                    return cast(T, end.value)
                finally:
                    self._look()
                outcome = failure = None
                try:
                    outcome = await self.carry_out(order)
                except (SessionError, HardwareError) as error:
                    failure = error
                if isinstance(outcome, Expected):
                    lights = [
                        each for each in lights if not each.coming.done()
                    ]  # it has been heard of
                    lights.append(outcome)
        finally:
            steps.close()
            for light in lights:
                light.cancel()

    async def carry_out(self, order: Order) -> Any:
        """Do what is ordered; return what has come of it."""
        match order:
            case protocol.Begin(operation, arguments, named):
                light = getattr(self.qnic, operation)(*arguments, **named)
                return expected(light, *_blocks_of(arguments))
            case protocol.Do(operation, arguments, named):
                return await getattr(self.qnic, operation)(*arguments, **named)
            case protocol.Collect(light, timeout_s):
                return await collected(self.qnic, cast(Expected, light), timeout_s)
            case protocol.Await(lights, timeout_s):
                tasks = [cast(Expected, light).coming for light in lights]
                first = asyncio.FIRST_COMPLETED
                await asyncio.wait(tasks, timeout=_finite(timeout_s), return_when=first)
                return tuple(task.done() for task in tasks)
            case protocol.Cancel(light):
                cast(Expected, light).cancel()
                return await asyncio.wait([cast(Expected, light).coming])
            case protocol.Now():
                return now_s()
            case protocol.Through(connection, steps):
                return await connection.perform(steps)
            case protocol.Wait(for_what):
                return await for_what()
            case protocol.Work(function, arguments):
                return await _to_the_end(asyncio.to_thread(function, *arguments))
            case protocol.Beside(steps) if self._beside is not None:
                going = [task for task in self._going if not task.done()]
                self._going = [*going, self._beside.create_task(self.perform(steps))]
                return None
            case protocol.Until(done, timeout_s):
                return await self._until(done, timeout_s)
            case _:
                raise ValueError(f"{order} at {type(self).__name__}, which cannot do it")

    async def _until(self, done: Callable[[], Any], timeout_s: float) -> bool:
        with suppress(TimeoutError):
            async with asyncio.timeout(_finite(timeout_s)):
                while not done():
                    entry = done, asyncio.get_running_loop().create_future()
                    self._waiting.append(entry)
                    try:
                        await entry[1]
                    finally:
                        self._waiting.remove(entry)
        return bool(done())

    def _look(self) -> None:
        """Let those go on for whom it is so now; who goes on first may undo it for the others."""
        for done, waiting in self._waiting:
            if not waiting.done() and done():
                waiting.set_result(None)


async def _to_the_end(work: Coroutine[Any, Any, Any]) -> Any:
    """Return what a thread returns; nobody goes on while it works, also not who is cancelled."""
    going = asyncio.create_task(work)
    try:
        return await asyncio.shield(going)
    except asyncio.CancelledError:
        await asyncio.wait([going])
        raise


def _finite(timeout_s: float) -> float | None:
    return None if timeout_s == inf else timeout_s


def _blocks_of(arguments: tuple[Any, ...]) -> tuple[BlockName, ...]:
    """Return what an operation of Qnic waits for: a block, several, or a number's two halves."""
    first = arguments[0]
    if isinstance(first, int):
        return tuple(BlockName(first, arguments[1], half) for half in (0, 1))
    return first if isinstance(first, tuple) else (first,)


def expected(light: Coroutine[Any, Any, Any], *blocks: BlockName) -> Expected:
    """Begin with an operation that waits for light of these blocks."""
    return Expected(asyncio.create_task(light, name=f"light of {blocks}"), blocks)


async def collected(qnic: Qnic, light: Expected, timeout_s: float) -> Any:
    """Return what has come of light that is over; None if no photon has in this time.

    Whether one has is for the hardware to say: this host may have been too busy to hear of it.
    """
    try:
        await asyncio.wait([light.coming], timeout=_finite(timeout_s))
        if not light.coming.done():
            qnic.give_up(*light.blocks)
        return await light.coming
    except NoLight:
        return None
    finally:
        light.cancel()
