"""Where programs of a NetQASM application listen for each other."""

import socket
from contextlib import ExitStack, closing

import pytest
from limits import SOON_S
from stepping import stepping

from applications.netqasm.process_time import counting
from applications.netqasm.text_format import GREETING, TEXTS_PORT, Greeting, encode_greeting
from applications.netqasm.texts import Exchange

BOB, ALICE, STRANGER = "127.0.0.1", "127.0.0.2", "127.0.0.3"
STRANGERS = 20  # silent, each for GREETING_TIMEOUT_S if it were waited for


def test_silent_connections_of_other_hosts_do_not_delay_a_program() -> None:
    exchange = Exchange("bob", BOB, {ALICE, BOB})
    with ExitStack() as stack:
        stack.callback(exchange.close)

        def connected(host: str) -> socket.socket:
            place = BOB, TEXTS_PORT
            return stack.enter_context(socket.create_connection(place, SOON_S, (host, 0)))

        for _ in range(STRANGERS):
            connected(STRANGER)
        alice = connected(ALICE)
        alice.sendall(encode_greeting(Greeting("alice", "bob", 0)))
        with exchange.wait_for("alice", 0, SOON_S) as taken:
            assert taken.getpeername() == alice.getsockname()


def test_a_program_that_waits_for_another_waits_for_time_of_the_network() -> None:
    """In place of an hour the clock leaps, as nobody else waits for an instant."""
    with stepping() as gate, counting(gate.time):
        exchange = Exchange("bob", BOB, {BOB})
        with closing(exchange), pytest.raises(TimeoutError, match="in 3600 s"):
            exchange.wait_for("alice", 0, 3600)
        assert gate.time.now_s() == 3600


@pytest.mark.parametrize("cut", [1, GREETING.size - 1])
def test_a_greeting_that_is_cut_is_read_whole(cut: int) -> None:
    exchange = Exchange("bob", BOB, {BOB})
    data = encode_greeting(Greeting("alice", "bob", 0))
    with closing(exchange), socket.create_connection((BOB, TEXTS_PORT), SOON_S) as alice:
        alice.sendall(data[:cut])
        with pytest.raises(TimeoutError, match="alice did not open socket 0"):
            exchange.wait_for("alice", 0, 0.05)
        alice.sendall(data[cut:])
        exchange.wait_for("alice", 0, SOON_S).close()
