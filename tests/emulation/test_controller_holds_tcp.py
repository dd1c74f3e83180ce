"""Real TCP while the controller holds a set-up: repeated, coalesced, and released once."""

import contextlib
import hashlib
import os
import shutil
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest
from controller_scene import (
    DEADLINE_S,
    HOSTS,
    QUANTUM,
    SESSION,
    Controller,
    Wire,
    connect,
    discover,
    flows,
    run,
    running,
    two_bridges,
)
from limits import wait_until

from wire.metadata.decoding import decode
from wire.metadata.header import METADATA_PORT
from wire.metadata.setup import SETUP_LENGTH, Setup
from wire.metadata.vocabulary import Handshake, Service, Verdict

pytestmark = pytest.mark.skipif(
    os.geteuid() != 0 or not all(map(shutil.which, ("ovs-vsctl", "ethtool"))),
    reason="needs root, Open vSwitch and ethtool",
)
DATA = bytes(range(256)) * 800
BARRIER_REPLY = 21

SERVER = f"""
import socket, sys
listener = socket.create_server(("{HOSTS["bob"]}", {METADATA_PORT}))
print("ready", flush=True)
connection, _ = listener.accept()
connection.settimeout({DEADLINE_S})
stream = connection.makefile("rb")
first = stream.read({SETUP_LENGTH})
connection.sendall(b"yes")
sys.stdout.write(first.hex() + " " + stream.read().hex())
"""
CLIENT = f"""
import socket, sys, time
connection = socket.create_connection(("{HOSTS["bob"]}", {METADATA_PORT}), {DEADLINE_S})
connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
connection.sendall(bytes.fromhex(sys.argv[1]))
connection.sendall(b"behind")
assert connection.recv(3) == b"yes"
connection.sendall(bytes(range(256)) * {len(DATA) // 256})
"""


class Delay:
    """Stands between a switch and the controller; keeps barrier replies until released."""

    def __init__(self, controller_port: int) -> None:
        self.listener = socket.create_server(("127.0.0.1", 0))
        self.port = self.listener.getsockname()[1]
        self.release = threading.Event()
        self.holding = threading.Event()
        self.sockets = [self.listener]
        self.thread = threading.Thread(target=self._run, args=(controller_port,))
        self.thread.start()

    def _run(self, controller_port: int) -> None:
        with contextlib.suppress(OSError):  # close() cuts all connections
            self._serve(controller_port)

    def _serve(self, controller_port: int) -> None:
        switch, _ = self.listener.accept()
        upstream = socket.create_connection(("127.0.0.1", controller_port))
        self.sockets += [switch, upstream]
        down = threading.Thread(target=self._copy, args=(upstream, switch))
        down.start()
        stream = switch.makefile("rb")
        while len(header := stream.read(8)) == 8:
            if header[1] == BARRIER_REPLY:
                self.holding.set()
                assert self.release.wait(DEADLINE_S)
            upstream.sendall(header + stream.read(int.from_bytes(header[2:4], "big") - 8))
        down.join(DEADLINE_S)

    def _copy(self, source: socket.socket, sink: socket.socket) -> None:
        with contextlib.suppress(OSError):
            while data := source.recv(65536):
                sink.sendall(data)

    def close(self) -> None:
        self.release.set()
        for end in self.sockets:
            end.shutdown(socket.SHUT_RDWR)
        self.thread.join(DEADLINE_S)
        for end in self.sockets:
            end.close()


@pytest.fixture
def bridges() -> Iterator[dict[str, Wire]]:
    with two_bridges() as wires:
        yield wires


@pytest.fixture(params=["ryu", pytest.param("os-ken", marks=pytest.mark.nightly)])
def controller(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Controller]:
    with running(request.param, tmp_path) as program:
        yield program


@pytest.fixture
def hosts(bridges: dict[str, Wire]) -> Iterator[dict[str, str]]:
    """Give alice and bob a namespace each, with an address and no checksum offload."""
    namespaces = {host: f"cat-{host}" for host in ("alice", "bob")}
    try:
        for host, namespace in namespaces.items():
            wire = bridges[host]
            run("ip", "netns", "add", namespace)
            run("ip", "link", "set", wire.outer, "netns", namespace)
            inside = ("ip", "netns", "exec", namespace)
            run(*inside, "ip", "address", "add", f"{HOSTS[host]}/24", "dev", wire.outer)
            run(*inside, "ip", "link", "set", wire.outer, "up")
            run(*inside, "ethtool", "-K", wire.outer, "tx", "off", "rx", "off")
        yield namespaces
    finally:
        for host, namespace in namespaces.items():
            if Path("/run/netns", namespace).exists():
                back = ("ip", "link", "set", bridges[host].outer, "netns", str(os.getpid()))
                run("ip", "netns", "exec", namespace, *back)
                run("ip", "netns", "del", namespace)


@pytest.fixture
def delay(controller: Controller) -> Iterator[Delay]:
    proxy = Delay(controller.port)
    try:
        yield proxy
    finally:
        proxy.close()


def start(namespace: str, program: str, *arguments: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        ["ip", "netns", "exec", namespace, sys.executable, "-c", program, *arguments],
        stdout=subprocess.PIPE,
        text=True,
    )


def repetitions(controller: Controller) -> int:
    return controller.log_text().count("dropped (repeated")


def test_a_held_set_up_is_repeated_by_tcp_and_released_once(
    controller: Controller,
    bridges: dict[str, Wire],
    hosts: dict[str, str],
    delay: Delay,
) -> None:
    connect(controller, delay.port)
    discover(controller, bridges)
    setup = Setup(SESSION, Service.SDC, Handshake.FRAMED, HOSTS["charlie"], 1000, 100, 1_000_000)
    with start(hosts["bob"], SERVER) as server:
        assert server.stdout is not None
        assert server.stdout.readline() == "ready\n"
        with start(hosts["alice"], CLIENT, setup.encode().hex()) as client:
            assert delay.holding.wait(DEADLINE_S)
            wait_until(lambda: repetitions(controller) >= 3, "three retransmissions")
            assert controller.record("granted") == []
            delay.release.set()
            first, rest = server.stdout.read().split(" ")
            assert client.wait(DEADLINE_S) == 0
    answer = decode(bytes.fromhex(first))
    assert isinstance(answer, Setup)
    assert (answer.verdict, answer.session) == (Verdict.GRANTED, SESSION)
    received = bytes.fromhex(rest)
    assert hashlib.sha256(received).digest() == hashlib.sha256(b"behind" + DATA).digest()
    assert len(controller.record("path_ready")) == 1
    wait_until(lambda: len(controller.record("torn_down")) == 1, "torn down")
    wait_until(lambda: "in_port" not in flows(QUANTUM), "dark")
