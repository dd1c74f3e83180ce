"""Whole stacks of alice, bob and charlie over loopback, with a real dispatcher.

In the place of controller and switch stands a relay that reads the set-up message of each
connection and writes a verdict into it, as the controller does. The light paths are set
once, by hand.
"""

import asyncio
import json
import os
from collections.abc import AsyncIterator, Awaitable, Callable, Coroutine, Sequence
from concurrent.futures import Future
from contextlib import AsyncExitStack, asynccontextmanager, suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, Literal, TextIO

import grpc
import pytest
from limits import SOON_S

import hosts.stack
from dispatcher.build import build_layer
from dispatcher.clock import NetworkClock
from dispatcher.server.server import Server, build_service
from hosts import network_loop
from hosts.client import blocking_session, session
from hosts.hardware.simulated import SimulatedQnic
from hosts.middleware.session.channel import MetadataChannel
from hosts.service_socket import ServiceSocket
from hosts.stack import Stack
from hosts.stack_socket import BYTES, QuantumSocketError
from qswitch_agent.hardware.optics import CrossConnect
from qswitch_agent.hardware.simulated import SimulatedSwitch
from wire import dispatcher_service
from wire.config import DispatcherConfig, Fiber, FiberEnd, HostConfig, PathOptics, QuantumSwitch
from wire.device import DeviceSettings
from wire.dispatcher_pb2 import StatusRequest
from wire.dispatcher_pb2_grpc import DispatcherStub
from wire.metadata.decoding import decode, message_length
from wire.metadata.header import HEADER, METADATA_PORT, Message, session_number
from wire.metadata.setup import SETUP_LENGTH, Setup
from wire.metadata.vocabulary import Verdict
from wire.optical import ANY_WAVELENGTH
from wire.parameters.physics import BellAnalyser, Device
from wire.verdict import Connection, seal

QNICS = {
    "alice": ["alice-q0"],
    "bob": ["bob-q0", "bob-q1"],
    "charlie": ["charlie-q0", "charlie-q1"],
    "eve": ["eve-q0", "eve-q1"],
}
PORTS = {
    "alice-q0": 1,
    "bob-q0": 2,
    "bob-q1": 3,
    "charlie-q0": 4,
    "charlie-q1": 5,
    "eve-q0": 6,
    "eve-q1": 7,
}
PATHS = [(4, 1), (1, 3), (5, 2)]
# Every stack listens at the same port: each process of tests, of this run or of another one that
# goes on beside it, has addresses of its own.
NUMBERS = dict(zip(QNICS, range(11, 99), strict=False))
ROW, COLUMN = divmod(os.getpid() % (254 * 127), 254)
OWN_ADDRESS = {name: f"127.{1 + COLUMN}.{2 * ROW}.{number}" for name, number in NUMBERS.items()}
RELAYED = {name: f"127.{1 + COLUMN}.{2 * ROW + 1}.{number}" for name, number in NUMBERS.items()}


def same_number(opener: str, count: int) -> int:
    """Return the number of a session alike in each process: light is drawn by it.

    It has an address, of which here only the last byte is always the same.
    """
    return session_number(f"127.0.0.{opener.rpartition('.')[2]}", count)


pytest.MonkeyPatch().setattr(hosts.stack, "session_number", same_number)  # as long as tests run

Judge = Callable[[Setup], Setup]
Ends = tuple[asyncio.StreamReader, asyncio.StreamWriter]
# The changed form of a message that goes "forth" or "back"; None: cut the connection.
Changed = Message | None
Change = Callable[[str, Message], Changed | Awaitable[Changed]]
Changes = asyncio.Queue[asyncio.Task[Changed] | None]


def grant(setup: Setup) -> Setup:
    """Return a set-up as the controller grants it, at a wavelength if that is left to it."""
    wavelength_pm = setup.wavelength_pm or Setup.wavelength_pm
    return replace(setup, verdict=Verdict.GRANTED, wavelength_pm=wavelength_pm)


def sealed(setup: Setup, host: str, connection: Connection) -> Setup:
    """Return a set-up message on its way to a host as the controller would seal it."""
    message = decode(seal(setup.encode(), device_key(host), connection))
    assert isinstance(message, Setup)
    return message


def arbitrated(setup: Setup, host: str, channel: MetadataChannel) -> Setup:
    """Return a set-up as the controller would grant it to who has opened a channel to a host."""
    acceptor, opener = channel.connection[:2], channel.connection[2:]
    return sealed(grant(setup), host, (*opener, *acceptor))


def device_key(host: str) -> str:
    """Return what a host shares with the controller."""
    return f"key of {host}".encode().hex()


async def pump(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    """Pass bytes on, and the end of this direction of the connection."""
    try:
        while data := await reader.read(1 << 16):
            write(writer, data)
        end(writer)
    except ConnectionError:
        writer.close()


def write(writer: asyncio.StreamWriter, data: bytes) -> None:
    """Say something; who is gone hears nothing."""
    if not writer.is_closing():
        writer.write(data)


def end(writer: asyncio.StreamWriter) -> None:
    """End the stream, unless its end has done so, or is gone."""
    if not writer.is_closing():
        with suppress(OSError):
            writer.write_eof()


async def alter(
    reader: asyncio.StreamReader, writer: asyncio.StreamWriter, way: str, change: Change
) -> None:
    """Pass messages on as a person in the middle would like them; end where that one cuts.

    A held message holds those behind it back no longer than itself.
    """
    changes: Changes = asyncio.Queue()
    reading = asyncio.create_task(_read(reader, changes, partial(change, way)))
    try:
        await _pass_on(changes, writer)
    finally:
        reading.cancel()
        with suppress(asyncio.CancelledError):
            await reading


async def _read(
    reader: asyncio.StreamReader,
    changes: Changes,
    change: Callable[[Message], Changed | Awaitable[Changed]],
) -> None:
    """Have every message changed at once; None is the end."""
    try:
        while True:
            header = await reader.readexactly(HEADER.size)
            length = message_length(header)
            assert length is not None
            data = header + await reader.readexactly(length - HEADER.size)
            changes.put_nowait(asyncio.create_task(_changed(change(decode(data)))))
    except asyncio.IncompleteReadError:
        pass
    except ConnectionError:
        changes.put_nowait(asyncio.create_task(_changed(None)))
    finally:
        changes.put_nowait(None)


async def _changed(change: Changed | Awaitable[Changed]) -> Changed:
    return await change if isinstance(change, Awaitable) else change


async def _pass_on(changes: Changes, writer: asyncio.StreamWriter) -> None:
    """Write the results of changes, in order; a change to nothing cuts the connection."""
    while (coming := await changes.get()) is not None:
        changed = await coming
        if changed is not None:
            write(writer, changed.encode())
        if changed is None or getattr(changed, "last", False):
            writer.close()
            return
    end(writer)


class Cut:
    """Cuts, for good, all connections of metadata between hosts."""

    def __init__(self) -> None:
        self._loop = asyncio.get_running_loop()
        self._writers: list[asyncio.StreamWriter] = []

    def watch(self, *writers: asyncio.StreamWriter) -> None:
        """Have these cut, too."""
        self._writers.extend(writers)

    def __call__(self) -> None:
        """Cut them, from any thread."""
        for writer in self._writers:
            self._loop.call_soon_threadsafe(writer.transport.abort)


def relay(
    name: str, judge: Judge, change: Change | None, cut: Cut
) -> Callable[..., Coroutine[Any, Any, None]]:
    """Return the server of a relay to a host; it changes what this host and others say."""

    async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        try:
            setup = decode(await reader.readexactly(SETUP_LENGTH))
        except asyncio.IncompleteReadError:  # who connected has nothing to ask any more
            writer.close()
            return
        assert isinstance(setup, Setup)
        there = await asyncio.open_connection(OWN_ADDRESS[name], METADATA_PORT)
        try:
            await pass_on(setup, (reader, writer), there)
        finally:  # also where the network ends before its connections
            for either in (writer, there[1]):
                either.close()

    async def pass_on(setup: Setup, here: Ends, there: Ends) -> None:
        own, peer = map(there[1].get_extra_info, ("sockname", "peername"))
        judged = judge(setup)
        if judged.wavelength_pm == ANY_WAVELENGTH:  # it is left to the controller
            judged = replace(judged, wavelength_pm=Setup.wavelength_pm)
        if judged.verdict != Verdict.PENDING:
            judged = sealed(judged, name, (*own, *peer))
        there[1].write(judged.encode())
        cut.watch(here[1], there[1])
        forth, back = (here[0], there[1]), (there[0], here[1])
        if change is None:
            await asyncio.gather(pump(*forth), pump(*back))
        else:
            await asyncio.gather(alter(*forth, "forth", change), alter(*back, "back", change))

    return serve


@asynccontextmanager
async def network(
    folder: Path,
    judge: Judge = grant,
    rotation: int = 0,
    analyser: str = "complete",
    settings: DeviceSettings | None = None,
    paths: Sequence[tuple[int, int]] = PATHS,
    devices: dict[str, Device] | None = None,
    change: Change | None = None,
    optics: Sequence[PathOptics] = (),
    cuts: "Future[Cut] | None" = None,
    backend: Literal["chp", "stim", "dense"] = "chp",
    events: TextIO | None = None,
    qnics: dict[str, list[str]] = QNICS,
    ports: dict[str, int] = PORTS,
    stacks: dict[str, Stack] | None = None,
    report: bool = True,
    state_inspection: bool = False,
    **fiber: Any,
) -> AsyncIterator[Path]:
    """Run everything; the sockets of the stacks are in the folder, the stacks in `stacks`.

    Hosts know what their devices can do, unless that is left out.
    """
    config = DispatcherConfig(
        listen="127.0.0.1:0",
        socket=str(folder / "dispatcher.sock"),
        seed=1,
        tokens={name: f"token of {name}" for name in (*qnics, "q1", "runner")},
        fibers=[
            Fiber(FiberEnd(port.split("-")[0], port), FiberEnd("q1", str(number)), **fiber)
            for port, number in ports.items()
        ],
        switches=[QuantumSwitch("q1", rotation=rotation, paths=list(optics))],
        devices={"bob": Device(analyser=BellAnalyser(analyser)), **(devices or {})},
        backend=backend,
        state_inspection=state_inspection,
    )
    errors: list[BaseException] = []
    cut = Cut()
    if cuts is not None:
        cuts.set_result(cut)
    server = Server(
        config, build_service(config, build_layer(config, NetworkClock(), events), errors.append)
    )
    await server.start()
    async with AsyncExitStack() as stack:
        stack.push_async_callback(server.stop, 0)
        await connect_paths(config.socket, paths)
        for name, own in qnics.items():
            host = await start_host(
                stack,
                folder,
                config.socket,
                name,
                own,
                judge,
                analyser,
                change,
                cut,
                config.devices.get(name, Device()) if report else Device(),
            )
            if stacks is not None:
                stacks[name] = host
            if settings is not None:
                host.device.set(settings)
        yield folder
    assert not errors


async def connect_paths(dispatcher: str, paths: Sequence[tuple[int, int]]) -> None:
    """Open light paths."""
    switch = SimulatedSwitch("q1", dispatcher, "token of q1")
    await switch.set_cross_connects(CrossConnect(*path) for path in paths)
    await switch.close()


async def start_host(
    stack: AsyncExitStack,
    folder: Path,
    dispatcher: str,
    name: str,
    qnics: list[str],
    judge: Judge,
    analyser: str,
    change: Change | None,
    cut: Cut,
    device: Device,
) -> Stack:
    """Start a host's stack and the relay in front of it."""
    config = HostConfig(
        name=name,
        address=OWN_ADDRESS[name],
        qnics=qnics,
        dispatcher=f"unix:{dispatcher}",
        token=f"token of {name}",
        socket=str(folder / f"{name}.sock"),
        hosts_file=str(hosts_file(folder)),
        source="charlie",
        seed=1,
        analyser=analyser,
        features=device.features.value,
        memory_qubits=device.memory.capacity,
        multi_photon=device.source.multi_photon,
        intensities=list(device.source.intensities),
        cutoff_s=device.memory.cutoff_s,
        compensates=device.compensator.retarders > 0,
        t1_s=device.memory.t1_s,
        t2_s=device.memory.t2_s,
        depolarizing_s=device.memory.depolarizing_s,
        pair_secrets=str(pair_secrets(folder)),
        keys=str(folder / "keys" / name),
        device_key=device_key(name),
    )
    qnic = SimulatedQnic(config.dispatcher, config.token, config.qnics)
    stack.push_async_callback(qnic.close)
    host = Stack(config, qnic)
    servers = [
        asyncio.start_server(host.serve, config.address, METADATA_PORT),
        asyncio.start_server(relay(name, judge, change, cut), RELAYED[name], METADATA_PORT),
        asyncio.start_unix_server(host.applications.serve, config.socket),
    ]
    if host.unit is not None:
        servers.append(asyncio.start_server(host.unit.serve_unit, RELAYED[name], host.unit.port))
    for starting in servers:
        await stack.enter_async_context(await starting)
    return host


def hosts_file(folder: Path) -> Path:
    """Return the file of all hosts' addresses."""
    file = folder / "hosts.json"
    file.write_text(json.dumps(RELAYED))
    return file


def pair_secrets(folder: Path) -> Path:
    """Return the folder of what hosts share."""
    made = folder / "pair-secrets"
    made.mkdir(exist_ok=True)
    return made


async def live_qubits(folder: Path) -> int:
    """Return how many photons the dispatcher still holds, once hosts have had time to let go."""
    async with grpc.aio.insecure_channel(f"unix:{folder}/dispatcher.sock") as channel:
        stub = DispatcherStub(channel)  # type: ignore[no-untyped-call]
        words = {"metadata": dispatcher_service.metadata("token of runner"), "timeout": SOON_S}
        for _attempt in range(100):
            live = int((await stub.Status(StatusRequest(), **words)).live_qubits)
            if live == 0:
                break
            await asyncio.sleep(0.02)
    return live


def transfer(folder: Path, data: bytes, **options: Any) -> tuple[bytes, dict[str, Any]]:
    """Send data from alice to bob; return what bob got and alice's statistics."""
    got = bytearray()
    options |= {"limit_s": SOON_S, "take": got.extend}
    with blocking_session(stacks_in(folder), BYTES, ("alice", "bob"), 7, **options) as session:
        session.results()
        session.sendall(data)
        session.end()
    return bytes(got), session.summary


def stacks_in(folder: Path) -> Callable[[str], str]:
    """Return what gives the socket of a host's stack."""
    return lambda host: str(folder / f"{host}.sock")


def accepted(folder: Path, service: str, listening: "Future[None]") -> dict[str, Any]:
    """Take part in a service at bob; return the summary."""
    with ServiceSocket(folder / "bob.sock") as listener:
        listener.settimeout(SOON_S)
        listener.listen(9, service)
        listening.set_result(None)
        return taken_part(listener)


def taken_part(listener: ServiceSocket) -> dict[str, Any]:
    """Take part in the next session; return the summary."""
    connection, _peer = listener.accept()
    with connection:
        while not connection.over:
            list(connection.results())
        return connection.summary


def requested(
    folder: Path, service: str, hosts: Sequence[str] = ("alice", "bob"), **options: Any
) -> list[dict[str, Any]]:
    """Ask for a service at the first host; return the summary of each."""

    async def run() -> list[dict[str, Any]]:
        stacks = stacks_in(folder)
        async with session(stacks, service, hosts, 9, limit_s=SOON_S, **options) as asked:
            await asked.results()
            await asked.end()
            return [end.summary for end in (asked.opener, *await asked.heard())]

    return asyncio.run(run())


def ask(
    folder: Path,
    service: str,
    judge: Judge = grant,
    physics: dict[str, Any] | None = None,
    **options: Any,
) -> list[dict[str, Any]]:
    """Run the network for one request of a service."""

    async def run() -> list[dict[str, Any]]:
        async with network(folder, judge, **(physics or {})):
            return await asyncio.to_thread(requested, folder, service, **options)

    return network_loop.run(run())


def refusal(folder: Path, service: str, judge: Judge = grant, **options: Any) -> str:
    """Ask for a service at alice, with nobody at bob; return alice's result."""

    def refused() -> str:
        with ServiceSocket(folder / "alice.sock") as asking:
            asking.settimeout(SOON_S)
            results = asking.request(service, ("bob", 9), **options)
            with pytest.raises(QuantumSocketError) as caught:
                list(results)
        return str(caught.value)

    async def run() -> str:
        async with network(folder, judge):
            return await asyncio.to_thread(refused)

    return network_loop.run(run())
