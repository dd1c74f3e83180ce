"""Plays a record through the physical layer again, without a network and without waiting.

Each stretch that the record names is released in its turn, with the times that the clock gave it
then. Each stretch runs the dispatcher's own code.
"""

import asyncio
import json
from collections import deque
from collections.abc import Iterator
from dataclasses import replace
from itertools import chain
from typing import Any, BinaryIO, TextIO

from google.protobuf.message import DecodeError, Message

from dispatcher.build import build_layer
from dispatcher.layer.journal import Journal
from dispatcher.recording.recorder import count_task, current_request, running_request
from dispatcher.refusal import Refusal
from dispatcher.server.server import build_service
from dispatcher.server.servicer import Service
from wire import dispatcher_record, typed_json
from wire.config import DispatcherConfig
from wire.dispatcher_record import BadRecord
from wire.record_pb2 import Entry, Request

MOST_TURNS = 1000  # of the event loop, until a task has come to its wait

Place = tuple[int, int]  # a task of a request


class Turns(Journal):
    """Lets each wait end when the record says so, and is the clock of the record."""

    def __init__(self) -> None:
        self._times: dict[int, deque[int]] = {}
        self._waiting: dict[Place, asyncio.Future[None]] = {}

    def add_time(self, request: int, time_ns: int) -> None:
        self._times.setdefault(request, deque()).append(time_ns)

    def now_ns(self) -> int:
        running = current_request.get()
        times = self._times.get(running.number) if running is not None else None
        if not times:
            number = running.number if running is not None else 0
            raise BadRecord(f"request {number} reads the clock more often than it did then")
        return times.popleft()

    async def wait_until(self, _time_ns: int) -> None:
        await self.resumed()

    async def resumed(self) -> None:
        running = current_request.get()
        if running is None:
            raise BadRecord("a task waits that belongs to no request")
        place = running.number, running.task()
        self._waiting[place] = asyncio.get_running_loop().create_future()
        await self._waiting[place]

    def begun(self, task: asyncio.Task[Any]) -> None:
        count_task(task)

    def timeout(self, _limit_s: float) -> asyncio.Timeout:
        """Return a time-out that never comes: those that came have changed nothing."""
        return asyncio.timeout(None)

    async def release(self, place: Place) -> None:
        """Let a task go on until its next wait."""
        for _ in range(MOST_TURNS):
            if (waiting := self._waiting.pop(place, None)) is not None:
                waiting.set_result(None)
                await asyncio.sleep(0)
                return
            await asyncio.sleep(0)
        raise BadRecord(f"task {place[1]} of request {place[0]} does not wait where it did then")


# A replay reaches nothing but the log that it is given, whatever the record says.
NOWHERE: dict[str, Any] = dict.fromkeys(
    ("listen", "socket", "event_log", "event_capture", "record", "qasm", "sabot"), ""
)


class NamesCode(BadRecord):
    """A record names files of code, which a replay would run."""


def replay(file: BinaryIO, event_log: TextIO, allow_code: bool = False) -> int:
    """Play a record again; write its events to a log and return how many requests there were.

    Raise BadRecord if the file is not a record of this version of the dispatcher, NamesCode if it
    names code that is not allowed.
    """
    entries = dispatcher_record.read(file)
    config = _config(next(entries, None))
    named = {fiber.noise for fiber in config.fibers if fiber.noise}
    parts = [device for switch in config.switches for device in switch.inner_devices.values()]
    devices = *config.devices.values(), *parts
    named |= {noise for device in devices for noise, _ in device.noises.values()}
    code = sorted(named)
    if code and not allow_code:
        raise NamesCode(f"it names code, which would be run: {', '.join(code)}")
    return asyncio.run(_play(entries, config, event_log))


def _config(header: Entry | None) -> DispatcherConfig:
    if header is None:
        raise BadRecord("it is empty")
    try:
        config = typed_json.read(DispatcherConfig, json.loads(header.header.config), "it")
        tokens = {node: node for node in config.tokens}  # nobody calls
        return replace(config, tokens=tokens, metrics_fd=None, **NOWHERE)
    except (ValueError, RecursionError) as error:
        raise BadRecord(f"its configuration is not of this version: {error}") from error


async def _play(entries: Iterator[Entry], config: DispatcherConfig, event_log: TextIO) -> int:
    turns, errors = Turns(), list[BaseException]()
    try:
        layer = build_layer(config, turns, event_log, journal=turns)
        service = build_service(config, layer, errors.append)
    except (ValueError, TypeError, AttributeError, OverflowError) as error:
        raise BadRecord(f"its configuration is not of this version: {error}") from error
    count, tasks = 0, set[asyncio.Task[None]]()
    for stretch in _stretches(entries, turns):
        if stretch.HasField("request"):
            count += 1
            task = asyncio.create_task(_perform(service, stretch.request))
            tasks.add(task)
            await asyncio.sleep(0)
        else:
            await turns.release((stretch.resumed.request, stretch.resumed.task))
        ended = {task for task in tasks if task.done()}
        tasks -= ended
        errors += [wrong for task in ended if (wrong := task.exception()) is not None]
        if errors:
            raise _unplayable(errors[0]) from errors[0]
    return count


def _stretches(entries: Iterator[Entry], turns: Turns) -> Iterator[Entry]:
    begin: Entry | None = None
    for entry in chain(entries, (None,)):
        if entry is not None and entry.HasField("ended"):
            return  # without the last stretch, of which times may be missing
        if entry is not None and entry.HasField("clock"):
            turns.add_time(entry.clock.request, entry.clock.time_ns)
            continue
        if begin is not None:
            yield begin
        begin = entry


def _unplayable(error: BaseException) -> BadRecord:
    if isinstance(error, BadRecord):
        return error
    return BadRecord(f"the dispatcher fails at it: {type(error).__name__}: {error}")


async def _perform(service: Service, entry: Request) -> None:
    """Do a recorded request; one that was refused is refused again."""
    with running_request(entry.number):
        try:
            await service.change(entry.node, entry.kind, _decoded(service, entry))
        except Refusal:
            return


def _decoded(service: Service, entry: Request) -> Message:
    row = service.table.rows.get(entry.kind)
    if row is None:
        raise BadRecord(f"request {entry.number} is of the unknown kind {entry.kind!r}")
    try:
        return row.message.FromString(entry.message)
    except DecodeError as error:
        raise BadRecord(f"request {entry.number} is malformed") from error
