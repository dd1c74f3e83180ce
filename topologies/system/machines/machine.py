"""Another machine as the runner has it: what it can be asked, and the programs it runs there."""

import asyncio
import itertools
import signal
import socket
import subprocess
import time
from collections.abc import Callable, Coroutine, Sequence
from concurrent.futures import Future
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from threading import Event
from typing import Any

from mininet.log import warn

from topologies.system.kernel.user_namespace import without_user_namespaces
from topologies.system.machines.relays import Relays, Stream
from topologies.system.processes.programs import NetworkError
from topologies.timeouts import (
    AGENT_ANSWER_TIMEOUT_S,
    BEAT_PERIOD_S,
    CHANNEL_CLOSE_TIMEOUT_S,
    LOST_TIMEOUT_S,
)
from wire.machine_channel import MOST_BODY_BYTES, Header, encode, receive
from wire.malformed import MalformedPacket
from wire.packed_folder import MOST_BYTES

PACKED = ".packed"  # how the file is called that a folder is packed into
CLOCK_TRIES = 21
NOWHERE = -1  # as a process id: of none on this machine
LOST_STATUS = -signal.SIGKILL

Write = Callable[[bytes], None]


@dataclass(frozen=True)
class ClockOffset:
    """How far another machine's clock is ahead, and how well that is known (s)."""

    offset_s: float
    error_s: float  # half of the fastest way there and back


class ProcessElsewhere:
    """A process on another machine: what a Program asks of a Popen."""

    pid = NOWHERE

    def __init__(self, machine: "Machine", number: int, write: Write) -> None:
        self._machine, self.number = machine, number
        self.write = write
        self.pid_there = NOWHERE
        self.user: int | None = None  # of a shell: its descriptor of the user namespace for it
        self._status: int | None = None
        self._ended = Event()

    def end(self, status: int) -> None:
        self._status = status
        self._ended.set()

    def poll(self) -> int | None:
        return self._status

    def wait(self, timeout: float | None = None) -> int:
        if not self._ended.wait(timeout):
            raise subprocess.TimeoutExpired(f"on {self._machine.name}", timeout or 0)
        assert self._status is not None
        return self._status

    def send_signal(self, number: int, /) -> None:
        if self._status is None and not self._machine.lost:
            self._machine.ask("signal", process=self.number, signal=number)

    def kill(self) -> None:
        self.send_signal(signal.SIGKILL)

    def type(self, data: bytes) -> None:
        """Type something at its terminal, and do not wait."""
        self._machine.tell("write", data, process=self.number)


class Machine:
    """Another machine, by the channel to its agent; all its methods are for other threads."""

    def __init__(
        self,
        about: Header,
        address: str,
        here: str,
        mtu: int,
        reader: asyncio.StreamReader,
        writer: asyncio.StreamWriter,
    ) -> None:
        """Begin to serve it in the loop that runs; `here` is this machine's address to it."""
        self.name, self.root, self.python = about["name"], about["root"], about["python"]
        self.address, self.here, self.mtu = address, here, mtu
        self.lost = ""  # why, if it is
        self.tunnels = ""  # by what links to it go (TunnelEnd.by)
        self.user_namespaces = True  # whether its hosts can have them, for all that is known
        self._reader, self._writer = reader, writer
        self._loop = asyncio.get_running_loop()
        self._numbers = itertools.count(1)
        self._answers: dict[int, Future[tuple[Any, bytes]]] = {}
        self._processes: dict[int, ProcessElsewhere] = {}
        self._heard_s = time.monotonic()
        self._closing = False
        self._relays = Relays(lambda path, number: self.tell("relay", path=path, relay=number))
        self._tasks = [asyncio.create_task(each) for each in (self._listen(), self._beat())]

    def check(self) -> None:
        """Raise NetworkError if the machine is lost."""
        if self.lost:
            raise self._loss()

    def _loss(self) -> NetworkError:
        return NetworkError(f"the machine {self.name} ({self.address}) was lost: {self.lost}")

    def ask(self, do: str, body: bytes = b"", **words: Any) -> Any:
        """Ask for something and return what it says; raise NetworkError if it cannot be had."""
        return self._asked(next(self._numbers), do, body, **words)[0]

    def tell(self, do: str, body: bytes = b"", **words: Any) -> None:
        """Ask for something that nobody waits for."""
        self._send({"ask": next(self._numbers), "do": do, **words}, body)

    def _asked(self, number: int, do: str, body: bytes = b"", **words: Any) -> tuple[Any, bytes]:
        answer: Future[tuple[Any, bytes]] = Future()
        self._answers[number] = answer  # before the check: what is lost from here on ends it
        try:
            self.check()
            self._send({"ask": number, "do": do, **words}, body)
            return answer.result(AGENT_ANSWER_TIMEOUT_S)
        except TimeoutError as error:
            raise NetworkError(
                f"{self.name} did not {do} in {AGENT_ANSWER_TIMEOUT_S:g} s"
            ) from error
        finally:
            self._answers.pop(number, None)

    def _send(self, header: Header, body: bytes) -> None:
        if not self.lost:
            self._loop.call_soon_threadsafe(self._writer.write, encode(header, body))

    def put(self, path: Path | str, data: bytes, there: Path | str | None = None) -> None:
        """Put a private file of these bytes there, by the same path or another."""
        target = str(there or path)
        under_way = f"{target}.{next(self._numbers)}"  # hosts put what they share at once
        for offset in range(0, max(len(data), 1), MOST_BODY_BYTES):
            end = offset + MOST_BODY_BYTES
            piece, is_last = data[offset:end], end >= len(data)
            self.ask("put", piece, path=target, under_way=under_way, is_last=is_last)

    def get(self, path: Path | str, most_bytes: int | None = None) -> bytes | None:
        """Return what is in a file there, None if there is none; NetworkError if it is longer."""
        content = bytearray()
        while True:
            is_there, data = self._asked(
                next(self._numbers), "get", path=str(path), offset=len(content)
            )
            content += data
            if not is_there:
                return None
            if most_bytes is not None and len(content) > most_bytes:
                raise NetworkError(f"{self.name}: {path} has more than {most_bytes:,} bytes")
            if len(data) < MOST_BODY_BYTES:
                return bytes(content)

    def put_folder(self, packed: bytes, folder: Path | str) -> None:
        file = f"{folder}{PACKED}"
        self.put(file, packed)
        self.ask("unpack", path=file, folder=str(folder))

    def get_folder(self, folder: Path | str) -> bytes:
        """Return a folder there, packed: its files and folders, and nothing that is a link."""
        file = f"{folder}{PACKED}"
        self.ask("pack", folder=str(folder), path=file)
        packed = self.get(file, MOST_BYTES)
        self.ask("remove", path=file)
        if packed is None:
            raise NetworkError(f"{self.name}: {file} is gone")
        return packed

    def lacks(self, programs: Sequence[str]) -> list[str]:
        return list(map(str, self.ask("lacks", programs=list(programs))))

    def within(self, pid: int, function: str, arguments: Sequence[Any]) -> Any:
        return self.ask("within", pid=pid, function=function, arguments=list(arguments))

    def tunnel(self, end: dict[str, Any], pid: int) -> None:
        self.ask("tunnel", end=end, pid=pid)

    def start(
        self,
        command: Sequence[str],
        write: Write,
        pid: int = 0,
        python: bool = False,
        environment: dict[str, str] | None = None,
    ) -> ProcessElsewhere:
        """Start a command there, in the namespace of a process; `write` takes what it says."""
        number = next(self._numbers)
        process = self._processes[number] = ProcessElsewhere(self, number, write)
        ask: dict[str, Any] = {"command": list(command), "pid": pid, "python": python}
        process.pid_there, _ = self._asked(number, "start", environment=environment or {}, **ask)
        return process

    def start_shell(self, node: str, write: Write, confined: bool) -> ProcessElsewhere:
        """Start the shell of a node there; where it can be confined, for a user namespace.

        The descriptor by which the shell enters that is `user` of the process, None without one.
        """
        number = next(self._numbers)
        shell = self._processes[number] = ProcessElsewhere(self, number, write)
        in_user_namespace = confined and self.user_namespaces
        ask: dict[str, Any] = {"node": node, "user_namespace": in_user_namespace}
        (shell.pid_there, shell.user, why), _ = self._asked(number, "shell", **ask)
        if why:
            self.user_namespaces = False
            warn(without_user_namespaces(f"hosts on {self.name}, from {node} on,", why))
        return shell

    def connect(self, terminal: socket.socket, process: ProcessElsewhere) -> None:
        """Let what comes from a socket be typed at a process, from now on."""
        terminal.setblocking(False)

        def read() -> None:
            if data := terminal.recv(MOST_BODY_BYTES):
                self._writer.write(
                    encode(
                        {
                            "ask": next(self._numbers),
                            "do": "write",
                            "process": process.number,
                        },
                        data,
                    )
                )
            else:
                self._loop.remove_reader(terminal)

        self._loop.call_soon_threadsafe(self._loop.add_reader, terminal, read)

    def disconnect(self, terminal: socket.socket) -> None:
        def close() -> None:
            self._loop.remove_reader(terminal)
            terminal.close()

        self._loop.call_soon_threadsafe(close)

    def relay(self, path: str) -> None:
        listening = asyncio.run_coroutine_threadsafe(self._relays.listen(path), self._loop)
        listening.result(AGENT_ANSWER_TIMEOUT_S)

    def take_relayed(self, number: object, stream: Stream) -> None:
        self._relays.take(number, stream)

    def clock_offset(self) -> ClockOffset:
        """Measure how far its clock is ahead: it was read at some time of the fastest answer."""
        samples = []
        for _ in range(CLOCK_TRIES):
            begin = time.time_ns()
            there = self.ask("clock")
            end = time.time_ns()
            samples.append((end - begin, there - (begin + end) / 2))
        way_ns, offset_ns = min(samples)
        return ClockOffset(offset_ns / 1e9, way_ns / 2e9)

    async def _listen(self) -> None:
        try:
            while (message := await receive(self._reader)) is not None:
                self._heard_s = time.monotonic()
                self._take(*message)
            self._lose("its worker has ended, or been killed")
        except (OSError, MalformedPacket) as error:
            self._lose(str(error))

    def _take(self, header: Header, body: bytes) -> None:
        if (number := header.get("answer")) is not None:
            answer = self._answers.get(number)
            if answer is not None and "error" in header:
                answer.set_exception(NetworkError(f"{self.name}: {header['error']}"))
            elif answer is not None:
                answer.set_result((header["result"], body))
            return
        process = self._processes[header["process"]]
        if "status" in header:
            del self._processes[header["process"]]
            process.end(header["status"])
        else:
            process.write(body)

    async def _beat(self) -> None:
        while not self.lost:
            self._writer.write(encode({"ask": 0, "do": "clock"}))
            await asyncio.sleep(BEAT_PERIOD_S)
            if time.monotonic() - self._heard_s > LOST_TIMEOUT_S:
                self._lose(f"it has not answered for {LOST_TIMEOUT_S:g} s")

    def _lose(self, why: str) -> None:
        if self.lost:
            return
        self.lost = why
        for process in list(self._processes.values()):  # other threads ask meanwhile
            process.end(LOST_STATUS)
        for answer in list(self._answers.values()):
            if not answer.done():
                answer.set_exception(self._loss())
        self._relays.close()
        self._writer.close()

    def close(self) -> Coroutine[Any, Any, None]:
        """Return what lets its agent end, with all that it has started."""

        async def end() -> None:
            self._lose("the network has ended")
            for task in self._tasks:
                task.cancel()
            self._loop.call_later(CHANNEL_CLOSE_TIMEOUT_S, self._writer.transport.abort)
            with suppress(OSError):  # it may end as it likes
                await self._writer.wait_closed()

        return end()
