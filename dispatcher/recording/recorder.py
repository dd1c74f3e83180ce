"""Writes what the dispatcher is asked, and what its clock says, into a private file."""

import asyncio
import json
import os
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import asdict, dataclass, replace
from itertools import count
from typing import Any, BinaryIO

from dispatcher.clock import Clock
from dispatcher.layer.journal import Journal
from wire import dispatcher_record
from wire.config import DispatcherConfig
from wire.record_pb2 import Clock as ClockEntry
from wire.record_pb2 import Entry, Header, Request, Resumed


@dataclass
class RunningRequest:
    """A request, and the tasks that do it, numbered in the order of their first wait."""

    number: int
    tasks: dict[asyncio.Task[Any] | None, int]

    def task(self) -> int:
        return self.number_of(asyncio.current_task())

    def number_of(self, task: asyncio.Task[Any] | None) -> int:
        return self.tasks.setdefault(task, len(self.tasks))


current_request: ContextVar[RunningRequest | None] = ContextVar("current_request", default=None)


@contextmanager
def running_request(number: int) -> Iterator[None]:
    running = RunningRequest(number, {asyncio.current_task(): 0})
    token = current_request.set(running)
    try:
        yield
    finally:
        current_request.reset(token)


def count_task(task: asyncio.Task[Any]) -> None:
    """Number a task of the running request, if any runs."""
    if (running := current_request.get()) is not None:
        running.number_of(task)


def open_private(path: str) -> BinaryIO:
    """Create a file that its owner alone can read; raise OSError if it exists."""
    descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    return os.fdopen(descriptor, "wb")


class Recorder(Journal):
    """Writes requests and the order of their doings."""

    def __init__(self, file: BinaryIO, config: DispatcherConfig) -> None:
        super().__init__(config.time)
        self._file, self._numbers = file, count(1)
        self._free_bytes = config.file_bytes
        dispatcher_record.begin(file)
        # Its paths are of that run, and its tokens nobody's business.
        public = replace(
            config,
            tokens=dict.fromkeys(config.tokens, ""),
            listen="",
            socket="",
            event_log="",
            record="",
            qasm="",
            sabot="",
        )
        self._write(Entry(header=Header(config=json.dumps(asdict(public)))))

    @contextmanager
    def request(self, node: str, kind: str, request: Any) -> Iterator[None]:
        number, message = next(self._numbers), request.SerializeToString()
        entry = Request(number=number, node=node, kind=kind, message=message)
        self._write(Entry(request=entry))
        try:
            with running_request(number):
                yield
        finally:
            self._file.flush()

    def begun(self, task: asyncio.Task[Any]) -> None:
        count_task(task)

    async def resumed(self) -> None:
        running = current_request.get()
        if running is not None:
            self.wait_over(running, running.task())

    def wait_over(self, running: RunningRequest, task: int) -> None:
        self._write(Entry(resumed=Resumed(request=running.number, task=task)))

    def clock_read(self, time_ns: int) -> None:
        running = current_request.get()
        if running is not None:
            self._write(Entry(clock=ClockEntry(request=running.number, time_ns=time_ns)))

    def _write(self, entry: Entry) -> None:
        """Append an entry, unless the record has ended because it became too long."""
        if self._free_bytes <= 0:
            return
        self._free_bytes -= dispatcher_record.write(self._file, entry)
        if self._free_bytes <= 0:
            dispatcher_record.end(self._file)


class RecordedClock:
    def __init__(self, inner: Clock, recorder: Recorder) -> None:
        self._inner, self._recorder = inner, recorder

    def now_ns(self) -> int:
        time_ns = self._inner.now_ns()
        self._recorder.clock_read(time_ns)
        return time_ns

    async def wait_until(self, time_ns: int) -> None:
        running = current_request.get()
        task = running.task() if running is not None else 0
        await self._inner.wait_until(time_ns)
        if running is not None:
            self._recorder.wait_over(running, task)
