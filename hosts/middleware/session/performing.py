"""Performers of protocols: everything that waits for hardware, clocks and threads.

An end with a connection also sends and receives on it (ends.py).
"""

import asyncio
from collections.abc import Callable, Coroutine
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from math import inf
from typing import Any, TypeVar, cast

from hosts.hardware.block_name import BlockName
from hosts.hardware.qnic import Qnic
from hosts.hardware.replies import HardwareError, NoLight
from hosts.middleware.session import protocol
from hosts.middleware.session.errors import SessionError
from hosts.middleware.session.protocol import Effect, Steps
from hosts.network_loop import now_s

T = TypeVar("T")


@dataclass(frozen=True)
class Expected:
    coming: asyncio.Task[Any]
    blocks: tuple[BlockName, ...]

    def cancel(self) -> None:
        """Expect it no longer; nobody reads its result."""
        if not self.coming.cancel() and not self.coming.cancelled():
            self.coming.exception()


@dataclass
class Performer:
    """Carries out effects of protocols on a host's hardware."""

    qnic: Qnic
    _beside: asyncio.TaskGroup | None = field(default=None, init=False, repr=False)
    _going: list[asyncio.Task[None]] = field(default_factory=list, init=False, repr=False)
    # Conditions that steps wait for, with their waiters.
    _waiting: list[tuple[Callable[[], Any], asyncio.Future[None]]] = field(
        default_factory=list, init=False, repr=False
    )

    async def perform_together(self, steps: Steps[T]) -> T:
        """Carry out steps and those that they start; the first failure ends all."""
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
        """Carry out a protocol, one effect after the other; return its result.

        Light that it has begun and not collected is given up at the end.
        """
        lights: list[Expected] = []
        outcome: Any = None
        failure: SessionError | HardwareError | None = None
        try:
            while True:
                try:
                    effect = steps.send(outcome) if failure is None else steps.throw(failure)
                except StopIteration as end:
                    return cast(T, end.value)
                finally:
                    self._look()
                outcome = failure = None
                try:
                    outcome = await self.carry_out(effect)
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

    async def carry_out(self, effect: Effect) -> Any:
        match effect:
            case protocol.Begin(operation, arguments, named):
                light = bound(self.qnic, operation)(*arguments, **named)
                return expected(light, *_blocks_of(arguments))
            case protocol.Do(operation, arguments, named):
                return await bound(self.qnic, operation)(*arguments, **named)
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
            case protocol.OnConnection(connection, steps):
                return await connection.perform(steps)
            case protocol.Wait(for_what):
                return await for_what()
            case protocol.Work(function, arguments):
                return await _to_the_end(asyncio.to_thread(function, *arguments))
            case protocol.Concurrently(steps) if self._beside is not None:
                going = [task for task in self._going if not task.done()]
                self._going = [*going, self._beside.create_task(self.perform(steps))]
                return None
            case protocol.WaitUntil(done, timeout_s):
                return await self._until(done, timeout_s)
            case _:
                raise ValueError(f"{effect} at {type(self).__name__}, which cannot do it")

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
        """Wake waiters whose condition holds; waking one may falsify another's."""
        for done, waiting in self._waiting:
            if not waiting.done() and done():
                waiting.set_result(None)


def bound(qnic: Any, operation: Callable[..., Any]) -> Callable[..., Any]:
    """Return a QNIC's own method of this name, or the operation itself, at this QNIC."""
    return getattr(qnic, operation.__name__, None) or partial(operation, qnic)


async def _to_the_end(work: Coroutine[Any, Any, Any]) -> Any:
    """Return what a thread returns; a cancelled caller also waits for its end."""
    going = asyncio.create_task(work)
    try:
        return await asyncio.shield(going)
    except asyncio.CancelledError:
        await asyncio.wait([going])
        raise


def _finite(timeout_s: float) -> float | None:
    return None if timeout_s == inf else timeout_s


def _blocks_of(arguments: tuple[Any, ...]) -> tuple[BlockName, ...]:
    """Return the blocks of an operation of Qnic: one, several, or a number's two halves."""
    first = arguments[0]
    if isinstance(first, int):
        return tuple(BlockName(first, arguments[1], half) for half in (0, 1))
    return first if isinstance(first, tuple) else (first,)


def expected(light: Coroutine[Any, Any, Any], *blocks: BlockName) -> Expected:
    """Begin with an operation that waits for light of these blocks."""
    return Expected(asyncio.create_task(light, name=f"light of {blocks}"), blocks)


async def collected(qnic: Qnic, light: Expected, timeout_s: float) -> Any:
    """Return the arrivals of light that is over; None if no photon arrived in this time.

    The hardware decides that: this host may have been too busy to notice.
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
