"""Ports for programs to listen on."""

import socket
from contextlib import ExitStack

from topologies.system.runs.runtime import EPHEMERAL_PORTS, free_port


def test_free_ports_are_in_a_row_and_none_that_connections_get() -> None:
    first = free_port(3)
    assert first + 2 < int(EPHEMERAL_PORTS.read_text().split()[0])
    with ExitStack() as listeners:
        for port in range(first, first + 3):
            listeners.enter_context(socket.create_server(("127.0.0.1", port)))
        assert free_port() not in range(first, first + 3)
