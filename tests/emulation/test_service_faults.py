"""Services that break, and set-ups that are made up, over a real network: nothing stays open."""

import re
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

import pytest
from conftest import wait_until
from fabric_scene import facts
from test_paths import flows, light_paths

from hosts.service_socket import ServiceSocket
from hosts.stack_socket import QuantumSocketError
from qmn.running.dispatcher_calls import held_blocks, status
from topologies.networks.network import Network
from wire.metadata.decoding import decode
from wire.metadata.header import HEADER, METADATA_PORT, Message, session_number
from wire.metadata.setup import Answer, Setup
from wire.metadata.vocabulary import Reason, Service, Verdict

ALICE, BOB, CHARLIE = "10.0.0.1", "10.0.0.2", "10.0.0.3"
UNUSED = 9_999  # of a session of alice
DEADLINE_S = 30.0
HOSTS = ("alice", "bob", "charlie")
SERVICES = ("teleport", "distribute", "bb84", "bbm92")
SPEAK = """
import socket, sys
with socket.create_connection((sys.argv[1], int(sys.argv[2])), 5) as connection:
    connection.settimeout(float(sys.argv[4]))
    connection.sendall(bytes.fromhex(sys.argv[3]))
    try:
        print('heard=' + connection.recv(65536).hex())
    except TimeoutError:
        print('silence')
"""


def require_nothing_left(network: Network) -> None:
    """Wait until no light path, no bypass and no photon is left of any session."""
    wait_until(lambda: not light_paths(), "the light paths are closed")
    bypass = "priority=300"
    wait_until(lambda: not any(bypass in line for line in flows("s1")), "the bypass is removed")
    wait_until(
        lambda: (
            not status(network).live_qubits
            and not any(held_blocks(network, host) for host in HOSTS)
        ),
        "all hosts have let go of all photons",
    )


@contextmanager
def listening(network: Network, service: str) -> Iterator[ServiceSocket]:
    """Have an application of bob wait for one service."""
    with ServiceSocket(network.runtime.socket("bob")) as listener:
        listener.settimeout(DEADLINE_S)
        listener.listen(9, service)
        yield listener


def asked(network: Network, service: str, count: int) -> tuple[ServiceSocket, Iterator[object]]:
    """Ask for a service at alice; return her socket, and results as they come."""
    alice = ServiceSocket(network.runtime.socket("alice"))
    alice.settimeout(DEADLINE_S)
    return alice, iter(alice.request(service, ("bob", 9), count=count, block_pairs=2000))


def test_when_either_application_goes_in_mid_session_nothing_stays(shared_network: Network) -> None:
    network = shared_network
    for service in SERVICES:
        for gone in ("alice", "bob"):
            with listening(network, service) as listener:
                alice, results = asked(network, service, 200_000)
                with alice, listener.accept()[0] as bob:
                    next(results)
                    assert light_paths()
                    stays, rest = (bob, bob.results()) if gone == "alice" else (alice, results)
                    (alice if gone == "alice" else bob).close()
                    with stays, pytest.raises(QuantumSocketError, match=r"gone|ended"):
                        list(rest)
            require_nothing_left(network)
        with listening(network, service) as listener:
            alice, results = asked(network, service, 3000)
            with alice, listener.accept()[0] as bob:
                list(results)
                alice.shutdown()
                while not bob.over:
                    list(bob.results())
        require_nothing_left(network)


def spoken(network: Network, data: bytes, to: str = BOB, wait_s: float = 2.0) -> Message | None:
    """Let alice say something to a stack; return what she hears, None for silence."""
    script = network.runtime.logs.parent / "speak.py"
    script.write_text(SPEAK)
    words = f"{sys.executable} {script} {to} {METADATA_PORT} {data.hex()} {wait_s}"
    output = network.host("alice").cmd(words)
    found = re.search(r"heard=([0-9a-f]*)", output)
    assert found or "silence" in output, output
    return decode(bytes.fromhex(found[1])) if found and found[1] else None


def test_set_ups_that_are_forged_or_unknown_open_nothing(shared_network: Network) -> None:
    network, before = shared_network, facts(shared_network, "granted")
    setup = Setup(
        session_number(ALICE, UNUSED), Service["TELEPORT"], 1, CHARLIE, 100, 1, 1_000_000, port=9
    )
    with listening(network, "teleport"):
        granted = replace(setup, verdict=Verdict.GRANTED)
        assert spoken(network, granted.encode()) is None  # the controller drops it
        assert spoken(network, replace(granted, service=Service.PAIR_SOURCE).encode(), CHARLIE) is (
            None
        )
        source = spoken(network, replace(setup, service=Service.PAIR_SOURCE).encode(), CHARLIE)
        assert isinstance(source, Answer)
        assert source.reason == Reason.UNKNOWN_SESSION
        unknown = bytearray(setup.encode())
        unknown[HEADER.size] = 99
        answer = spoken(network, bytes(unknown))
        assert isinstance(answer, Answer)
        assert answer.reason == Reason.UNSUPPORTED
        assert "unknown service 99: choose one of 1 (SDC)" in answer.text
        require_nothing_left(network)
        assert facts(network, "granted") == before


def test_a_set_up_that_is_sent_again_is_refused_and_its_paths_are_closed(
    shared_network: Network,
) -> None:
    network, before = shared_network, len(facts(shared_network, "granted"))
    with listening(network, "teleport") as listener:
        alice, results = asked(network, "teleport", 1000)
        with alice, listener.accept()[0] as bob:
            list(results)
            alice.shutdown()
            list(bob.results())
    require_nothing_left(network)
    granted = facts(network, "granted")[before]
    session = int(str(granted["session"]), 16)
    again = Setup(session, Service["TELEPORT"], 1, CHARLIE, 2000, 1, 50_000_000, port=9)
    with listening(network, "teleport"):
        answer = spoken(network, again.encode(), wait_s=5)
        assert isinstance(answer, Answer)
        assert answer.reason == Reason.UNKNOWN_SESSION
        assert f"session {session:016x} was here before" in answer.text
        require_nothing_left(network)
