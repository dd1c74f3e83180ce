"""Shares of a listener's connections: of one peer, of all, and where no descriptor is left."""

import asyncio
import os
import resource
import socket
import struct
from collections.abc import Iterator
from contextlib import ExitStack, closing, contextmanager

import grpc
import pytest
import uvloop
from limits import SOON_S, until

from programs import connection_shares
from programs.connection_shares import (
    STREAMS,
    LocalUsers,
    SharedListener,
    Shares,
    StreamServer,
    grpc_options,
    keep_shares,
    peer_of,
    shares,
)

OF_ONE, ALL = 4, 10
MAX_CONCURRENT_STREAMS = struct.Struct("!HI")  # a setting of HTTP/2: RFC 9113, 6.5.2
LOOPS = pytest.mark.parametrize("loop", [asyncio.new_event_loop, uvloop.new_event_loop])


@pytest.fixture
def _small(monkeypatch: pytest.MonkeyPatch) -> None:
    """Give small shares, and take two addresses of the loopback for two hosts."""
    monkeypatch.setattr(connection_shares, "shares", lambda: Shares(ALL, OF_ONE))
    monkeypatch.setattr(connection_shares, "peer_of", lambda address, _users: address[0])
    monkeypatch.setattr(connection_shares, "SHARES_LOOK_S", 0.01)


def connected(address: tuple[str, int], host: int) -> socket.socket:
    """Return a connection of a host that waits for an answer."""
    return socket.create_connection(address, SOON_S, source_address=(f"127.0.0.{host}", 0))


def is_closed(connection: socket.socket) -> bool:
    """Return whether the other end has closed a connection, of which nothing is read else."""
    connection.settimeout(0.2)
    try:
        return connection.recv(1) == b""
    except TimeoutError:
        return False
    except ConnectionError:
        return True


def accepted(listener: SharedListener) -> Iterator[socket.socket]:
    """Yield the connections that a listener accepts now."""
    while True:
        try:
            yield listener.accept()[0]
        except BlockingIOError:
            return


@contextmanager
def listening() -> Iterator[SharedListener]:
    with SharedListener(socket.create_server(("127.0.0.1", 0))) as listener:
        yield listener


@pytest.mark.usefixtures("_small")
def test_a_peer_has_its_share_and_others_theirs() -> None:
    with listening() as listener, ExitStack() as stack:
        address = listener.getsockname()
        theirs = [stack.enter_context(connected(address, 2)) for _ in range(OF_ONE + 3)]
        held = list(accepted(listener))
        assert [is_closed(each) for each in theirs] == [False] * OF_ONE + [True] * 3
        other = stack.enter_context(connected(address, 3))
        held += accepted(listener)
        assert not is_closed(other)
        assert len(held) == OF_ONE + 1
        for each in held:
            each.close()


@pytest.mark.usefixtures("_small")
def test_looking_for_excess_connections_leaves_no_descriptor_behind() -> None:
    with listening() as listener, open(os.devnull):
        before = os.listdir("/proc/self/fd")
        connection_shares.close_excess(listener.getsockname()[1])
        assert len(os.listdir("/proc/self/fd")) == len(before)


@pytest.mark.usefixtures("_small")
def test_all_peers_together_have_no_more_than_all() -> None:
    with listening() as listener, ExitStack() as stack:
        for host in range(2, 7):
            for _ in range(OF_ONE):
                stack.enter_context(connected(listener.getsockname(), host))
        held = [stack.enter_context(each) for each in accepted(listener)]
        assert len(held) == ALL


@pytest.mark.usefixtures("_small")
def test_it_is_logged_once_that_a_peer_is_refused(caplog: pytest.LogCaptureFixture) -> None:
    with listening() as listener, ExitStack() as stack:
        for _ in range(OF_ONE + 3):
            stack.enter_context(connected(listener.getsockname(), 2))
        for each in accepted(listener):
            stack.enter_context(each)
    lines = [each.getMessage() for each in caplog.records if each.name == "connections"]
    assert lines == [f"127.0.0.2 has {OF_ONE} connections of {ALL}: more refused"]


@pytest.mark.usefixtures("_small")
def test_who_has_closed_a_connection_has_a_place_for_another() -> None:
    with listening() as listener, ExitStack() as stack:
        for _ in range(3 * OF_ONE):
            stack.enter_context(connected(listener.getsockname(), 2))
            (connection,) = accepted(listener)
            os.close(connection.detach())  # as TLS and event loops take it over


@contextmanager
def no_descriptor_left() -> Iterator[None]:
    """Let this process open no more files."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    with ExitStack() as stack:
        lowest = stack.enter_context(open(os.devnull)).fileno()
        stack.close()
        resource.setrlimit(resource.RLIMIT_NOFILE, (lowest, hard))
        try:
            yield
        finally:
            resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))


async def echo(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    with closing(writer):
        writer.write(await reader.readline())


@pytest.mark.usefixtures("_small")
@LOOPS
def test_without_descriptors_a_server_refuses_and_serves_again(loop: object) -> None:
    async def scene() -> None:
        listener = socket.create_server(("127.0.0.1", 0))
        address = listener.getsockname()
        server = StreamServer(echo, listener)
        with ExitStack() as stack:
            waiting = [stack.enter_context(connected(address, host)) for host in (2, 3)]
            stack.enter_context(no_descriptor_left())
            assert [await asyncio.to_thread(is_closed, each) for each in waiting] == [True] * 2
        with connected(address, 2) as later:
            later.sendall(b"again\n")
            assert await asyncio.to_thread(later.recv, 100) == b"again\n"
        server.close()

    with asyncio.Runner(loop_factory=loop) as runner:  # type: ignore[arg-type]
        runner.run(scene())


@pytest.mark.usefixtures("_small")
@LOOPS
def test_a_server_on_either_loop_keeps_the_share(loop: object) -> None:
    async def scene() -> None:
        listener = socket.create_server(("127.0.0.1", 0))
        address = listener.getsockname()
        server = StreamServer(echo, listener)
        with ExitStack() as stack:
            theirs = [stack.enter_context(connected(address, 2)) for _ in range(OF_ONE + 2)]
            closed = [await asyncio.to_thread(is_closed, each) for each in theirs]
            assert closed == [False] * OF_ONE + [True] * 2
        server.close()

    with asyncio.Runner(loop_factory=loop) as runner:  # type: ignore[arg-type]
        runner.run(scene())


@pytest.mark.usefixtures("_small")
def test_grpc_keeps_the_share_too() -> None:
    async def scene() -> None:
        server = grpc.aio.server(options=grpc_options())
        port = server.add_insecure_port("127.0.0.1:0")
        await server.start()
        sharing = asyncio.create_task(keep_shares(port))
        with ExitStack() as stack:
            address = ("127.0.0.1", port)
            theirs = [stack.enter_context(connected(address, 2)) for _ in range(OF_ONE + 3)]
            other = stack.enter_context(connected(address, 3))
            greeting = await asyncio.to_thread(other.recv, 1 << 16)
            assert MAX_CONCURRENT_STREAMS.pack(3, STREAMS) in greeting
            await until(lambda: sum(map(lasts, theirs)) <= OF_ONE)
            assert lasts(other)
            assert sum(map(lasts, theirs)) == OF_ONE
        sharing.cancel()
        await server.stop(0)

    asyncio.run(scene())


def lasts(connection: socket.socket) -> bool:
    """Return whether gRPC, which greets first, has not closed a connection."""
    connection.setblocking(False)
    try:
        return bool(connection.recv(1 << 16))
    except BlockingIOError:
        return True
    except ConnectionError:
        return False


def test_shares_leave_most_files_of_a_process_to_others(monkeypatch: pytest.MonkeyPatch) -> None:
    for files, expected in ((256, (64, 16)), (1024, (256, 64)), (65536, (1024, 128))):
        monkeypatch.setattr(resource, "getrlimit", lambda _which, files=files: (files, files))
        assert shares() == expected


def test_a_peer_is_a_user_on_the_loopback_and_an_address_elsewhere() -> None:
    assert peer_of(("10.0.0.2", 40000), LocalUsers()) == "10.0.0.2"
    with listening() as listener, socket.create_connection(listener.getsockname()) as connection:
        assert peer_of(connection.getsockname(), LocalUsers()) == f"user {os.geteuid()}"
