"""The agent of a runner on another machine: does there what the runner asks for its nodes.

    python -m topologies.system.machines.agent NAME ADDRESS:PORT

It connects to the runner with the certificates that it reads, as JSON. The network is that of the
machine; processes and /run are its own (topologies/own_namespaces), so all that it has started ends
with it.
"""

import asyncio
import json
import os
import pty
import signal
import ssl
import subprocess
import sys
import termios
import time
from collections.abc import Awaitable, Callable, Coroutine, Sequence
from contextlib import suppress
from pathlib import Path
from shutil import which
from tempfile import TemporaryDirectory
from types import SimpleNamespace
from typing import Any

from topologies.system.confinement.confinement import ruled_here
from topologies.system.kernel import interfaces
from topologies.system.kernel.user_namespace import NoUserNamespace, UserNamespace
from topologies.system.machines.agent_files import AgentFiles
from topologies.system.machines.relays import Stream, join
from topologies.system.machines.source import fingerprint
from topologies.system.machines.tunnel import TunnelEnd
from topologies.system.processes.programs import (
    ENVIRONMENT,
    ROOT,
    NetworkError,
    callers_environment,
    python,
)
from topologies.system.processes.shells import LOCAL_FLAGS, PROMPT, shell_command
from topologies.timeouts import AGENT_CONNECT_TIMEOUT_S
from wire.machine_channel import Header, encode, receive

MODULE = "topologies.system.machines.agent"
CHUNK_BYTES = 1 << 16
BESIDE = "pack", "unpack"  # what is done while other things are: it can take seconds
Connect = Callable[[], Awaitable[Stream]]  # to the runner
WITHIN = {
    each.__name__: each
    for each in (
        interfaces.set_up,
        interfaces.set_address,
        interfaces.set_mtu,
        interfaces.hardware_address,
        interfaces.finish_checksums,
        interfaces.write_ipv6_off,
    )
}


class Agent(AgentFiles):
    """Programs of a runner on this machine, and what else it asks."""

    def __init__(self, connect: Connect, stream: Stream) -> None:
        self._connect = connect
        self._reader, self._writer = stream
        self._processes: dict[int, Followed] = {}
        self._terminals: dict[int, int] = {}
        self._tasks: set[asyncio.Task[None]] = set()

    async def serve(self) -> None:
        """Do what is asked, one thing after the other, until the runner ends."""
        while (message := await receive(self._reader)) is not None:
            answering = self._answer(*message)
            if message[0]["do"] in BESIDE:
                self._begin(answering)
            else:
                await answering

    async def _answer(self, header: Header, body: bytes) -> None:
        answer: Header = {"answer": header["ask"]}
        try:
            result, data = await getattr(self, f"do_{header['do']}")(header, body)
            answer["result"] = result
        except (NetworkError, OSError) as error:
            answer["error"], data = str(error), b""
        self._writer.write(encode(answer, data))
        await self._writer.drain()

    async def do_clock(self, _header: Header, _body: bytes) -> tuple[Any, bytes]:
        return time.time_ns(), b""

    async def do_lacks(self, header: Header, _body: bytes) -> tuple[Any, bytes]:
        """Say which of some programs are not installed on this machine."""
        where = callers_environment().get("PATH")
        return [name for name in header["programs"] if which(name, path=where) is None], b""

    async def do_ruled(self, _header: Header, _body: bytes) -> tuple[Any, bytes]:
        return [str(path) for path in ruled_here()], b""

    async def do_within(self, header: Header, _body: bytes) -> tuple[Any, bytes]:
        with interfaces.network_of(SimpleNamespace(name="a node", pid=header["pid"])):
            return WITHIN[header["function"]](*header["arguments"]), b""

    async def do_tunnel(self, header: Header, _body: bytes) -> tuple[Any, bytes]:
        TunnelEnd(**header["end"]).make(header["pid"])
        return None, b""

    async def do_pair(self, header: Header, _body: bytes) -> tuple[Any, bytes]:
        interfaces.make_pair(
            [
                (name, address, SimpleNamespace(pid=pid, inNamespace=True))
                for name, address, pid in header["ends"]
            ]
        )
        return None, b""

    async def do_start(self, header: Header, _body: bytes) -> tuple[Any, bytes]:
        """Start a program; what it says, and how it ends, follows."""
        command = [python(), *header["command"]] if header["python"] else header["command"]
        within = ["mnexec", "-a", str(header["pid"])] if header["pid"] else []
        variables = ENVIRONMENT if header["python"] else {}
        process = await asyncio.create_subprocess_exec(
            *within,
            *command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            cwd=ROOT,
            env={**callers_environment(), **variables, **header["environment"]},
            start_new_session=True,
        )
        self._follow_from_now_on(header["ask"], process)
        return process.pid, b""

    async def do_shell(self, header: Header, _body: bytes) -> tuple[Any, bytes]:
        """Start the shell of a node at a terminal, in a user namespace's network if it is wanted.

        Say its process id, by which descriptor it can enter that user namespace (None if there is
        none), and why it has none although it is wanted.
        """
        ours, theirs = silent_terminal()

        def begin(where: Sequence[str], descriptors: Sequence[int]) -> "subprocess.Popen[bytes]":
            return subprocess.Popen(
                [*where, *shell_command(header["node"])],
                stdin=theirs,
                stdout=theirs,
                stderr=theirs,
                cwd=ROOT,
                env={**callers_environment(), "PS1": PROMPT},
                start_new_session=True,
                pass_fds=descriptors,
            )

        user, why = None, ""
        try:
            if header["user_namespace"]:
                try:
                    user = UserNamespace()
                except NoUserNamespace as error:
                    why = str(error)
            shell = begin(["mnexec", "-cn"], []) if user is None else in_user_namespace(user, begin)
        finally:
            os.close(theirs)
        self._terminals[header["ask"]] = ours
        self._follow_from_now_on(header["ask"], Started(shell), ours)
        return [shell.pid, user and user.descriptor, why], b""

    def _follow_from_now_on(
        self, number: int, process: "Followed", terminal: int | None = None
    ) -> None:
        self._processes[number] = process
        self._begin(self._follow(number, process, terminal))

    def _begin(self, what: Coroutine[Any, Any, None]) -> None:
        task = asyncio.create_task(what)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def do_relay(self, header: Header, _body: bytes) -> tuple[Any, bytes]:
        self._begin(self._relay(header["path"], header["relay"]))
        return None, b""

    async def _relay(self, path: str, number: int) -> None:
        with suppress(OSError):  # then the runner has gone
            there = await self._connect()
            there[1].write(encode({"relay": number}))
            try:
                here = await asyncio.open_unix_connection(path)
            except OSError:
                there[1].close()  # who has connected to the runner finds that closed, too
                return
            await join(here, there)

    async def do_write(self, header: Header, body: bytes) -> tuple[Any, bytes]:
        if header["process"] in self._terminals:
            os.write(self._terminals[header["process"]], body)
        return None, b""

    async def do_signal(self, header: Header, _body: bytes) -> tuple[Any, bytes]:
        process = self._processes.get(header["process"])
        if process is not None and process.returncode is None:
            with suppress(ProcessLookupError):  # it has just ended
                os.killpg(process.pid, header["signal"])
        return None, b""

    async def _follow(self, number: int, process: "Followed", terminal: int | None) -> None:
        ended = asyncio.create_task(process.wait())
        async for chunk in self._chunks(process, terminal):
            self._writer.write(encode({"process": number}, chunk))
            await self._writer.drain()
        status = await ended
        if terminal is not None:
            del self._terminals[number]
            os.close(terminal)
        del self._processes[number]
        self._writer.write(encode({"process": number, "status": status}))
        await self._writer.drain()

    async def _chunks(self, process: "Followed", terminal: int | None) -> Any:
        if terminal is None:
            assert process.stdout is not None
            while chunk := await process.stdout.read(CHUNK_BYTES):
                yield chunk
            return
        loop, readable = asyncio.get_running_loop(), asyncio.Event()
        loop.add_reader(terminal, readable.set)
        try:
            while True:
                await readable.wait()
                readable.clear()
                try:
                    yield os.read(terminal, CHUNK_BYTES)
                except BlockingIOError:
                    continue  # it has been read meanwhile
                except OSError:
                    return  # nobody has its other end open
        finally:
            loop.remove_reader(terminal)


class Started:
    """A process that another thread has started: what is asked of one of asyncio's."""

    stdout: asyncio.StreamReader | None = None

    def __init__(self, process: "subprocess.Popen[bytes]") -> None:
        self._process, self.pid = process, process.pid

    @property
    def returncode(self) -> int | None:
        return self._process.poll()

    async def wait(self) -> int:
        loop, ended = asyncio.get_running_loop(), asyncio.Event()
        end = os.pidfd_open(self.pid)
        loop.add_reader(end, ended.set)
        try:
            await ended.wait()
        finally:
            loop.remove_reader(end)
            os.close(end)
        return self._process.wait()


Followed = asyncio.subprocess.Process | Started
Begin = Callable[[Sequence[str], Sequence[int]], "subprocess.Popen[bytes]"]


def in_user_namespace(user: UserNamespace, begin: Begin) -> "subprocess.Popen[bytes]":
    return user.start(lambda: begin([], [user.descriptor]))


def silent_terminal() -> tuple[int, int]:
    """Return both ends of a terminal that does not say again what is typed."""
    ours, theirs = pty.openpty()
    os.set_blocking(ours, False)
    settings = termios.tcgetattr(theirs)
    settings[LOCAL_FLAGS] &= ~termios.ECHO
    termios.tcsetattr(theirs, termios.TCSANOW, settings)
    return ours, theirs


def trust(certificates: dict[str, str]) -> ssl.SSLContext:
    """Return what the agent's side of the channel is to be: it knows one authority alone."""
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.minimum_version = ssl.TLSVersion.TLSv1_3
    context.load_verify_locations(cadata=certificates["authority"])
    with TemporaryDirectory(dir="/run") as folder:  # which is this agent's own, in memory
        file = Path(folder, "own.pem")
        file.write_text(certificates["certificate"] + certificates["private_key"])
        context.load_cert_chain(file)
    return context


async def run(name: str, runner: str, certificates: dict[str, str]) -> None:
    host, _, port = runner.rpartition(":")
    context = trust(certificates)

    async def connect() -> Stream:
        async with asyncio.timeout(AGENT_CONNECT_TIMEOUT_S):
            return await asyncio.open_connection(host, int(port), ssl=context)

    stream = await connect()
    about = {"name": name, "root": str(ROOT), "python": python(), "source": fingerprint()}
    stream[1].write(encode(about))
    await Agent(connect, stream).serve()


def main() -> int:
    name, runner = sys.argv[1:]
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the runner's to hear
    try:
        asyncio.run(run(name, runner, json.load(sys.stdin)))
    except (OSError, TimeoutError) as error:
        print(f"the runner at {runner}: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
