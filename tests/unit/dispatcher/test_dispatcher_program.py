"""The program: it says when it serves, ends cleanly, and names what is wrong."""

import signal
import socket
import stat
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import forked_python
import grpc
import pytest
import uvloop
from dispatcher_network import configuration
from limits import SOON_S

from dispatcher.clock import NetworkClock
from wire import dispatcher_service
from wire.config import DispatcherConfig
from wire.dispatcher_pb2 import StatusRequest
from wire.dispatcher_pb2_grpc import DispatcherStub
from wire.network_time import NetworkTime


def command(config: DispatcherConfig, folder: Path) -> list[str]:
    """Return the command that runs the dispatcher with a configuration."""
    path = folder / "dispatcher.json"
    config.write(path)
    return [sys.executable, "-m", "dispatcher", "--config", str(path)]


@contextmanager
def started(config: DispatcherConfig, folder: Path) -> Iterator[subprocess.Popen[str]]:
    """Run the dispatcher until the block is left."""
    pipe = subprocess.PIPE
    with subprocess.Popen(command(config, folder), stdout=pipe, stderr=pipe, text=True) as program:
        try:
            yield program
        finally:
            program.kill()


def refusal(config: DispatcherConfig, folder: Path) -> str:
    """Run the dispatcher, which must fail, and return what it says."""
    result = forked_python.run(command(config, folder), SOON_S)
    assert result.returncode == 1
    assert result.stdout == ""
    return result.stderr


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_it_serves_when_ready_and_ends_cleanly_at_a_signal(tmp_path: Path, number: int) -> None:
    config = configuration(tmp_path, event_log=str(tmp_path / "events.log"))
    with started(config, tmp_path) as program:
        assert program.stdout
        assert program.stdout.readline() == "ready\n"
        sockets = Path(config.socket), Path(dispatcher_service.cross_connects_socket(config.socket))
        assert [stat.S_IMODE(path.stat().st_mode) for path in sockets] == [0o600, 0o600]
        with grpc.insecure_channel(f"unix:{config.socket}") as channel:
            stub = DispatcherStub(channel)  # type: ignore[no-untyped-call]
            metadata = dispatcher_service.metadata("token of runner")
            reply = stub.Status(StatusRequest(), metadata=metadata, timeout=SOON_S)
            assert reply.backend == "chp"
        program.send_signal(number)
        assert program.wait(SOON_S) == 0
        assert program.stdout.read() == ""
    assert not any(path.exists() for path in sockets)


def test_a_taken_port_is_named_in_one_line(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0), reuse_port=True) as holder:
        address = f"127.0.0.1:{holder.getsockname()[1]}"
        message = refusal(configuration(tmp_path, listen=address), tmp_path)
    assert message.count("\n") == 1
    assert f"cannot listen on {address}" in message


def test_a_socket_path_that_is_too_long_is_named(tmp_path: Path) -> None:
    config = configuration(tmp_path, socket=str(tmp_path / ("d" * 100)))
    assert "shorten it" in refusal(config, tmp_path)


def test_an_empty_token_is_named(tmp_path: Path) -> None:
    config = configuration(tmp_path, tokens={"alice": ""})
    assert "token of alice is empty" in refusal(config, tmp_path)


def test_a_configuration_of_another_kind_is_named(tmp_path: Path) -> None:
    path = tmp_path / "dispatcher.json"
    path.write_text("{}")
    result = forked_python.run([sys.executable, "-m", "dispatcher", "--config", str(path)], SOON_S)
    assert result.returncode == 1
    assert str(path) in result.stderr
    assert result.stderr.count("\n") == 1


def test_the_clock_is_that_of_captures_and_never_goes_back() -> None:
    before = time.time_ns()
    clock = NetworkClock()
    times = [clock.now_ns() for _ in range(1000)]
    assert abs(times[0] - before) < 1_000_000_000
    assert times == sorted(times)


def test_a_slower_clock_begins_with_the_time_of_captures_and_goes_k_times_slower() -> None:
    since_ns = time.time_ns()
    clock = NetworkClock(NetworkTime(1000.0, since_ns))
    began_ns = time.monotonic_ns()
    first_ns = clock.now_ns()
    uvloop.run(clock.wait_until(first_ns + 20_000))  # 20 us of the network: 20 ms here
    waited_ns, passed_ns = time.monotonic_ns() - began_ns, clock.now_ns() - first_ns
    assert waited_ns >= 20_000_000
    assert passed_ns >= 20_000
    assert passed_ns * 1000 <= time.monotonic_ns() - began_ns + 1000
    assert first_ns >= since_ns
