"""Sockets of another process that are held while that closes its own."""

import os
import socket
import subprocess
import sys

from limits import SOON_S

from topologies.system.kernel.packet_sockets import close, held, packet_sockets, taken


def test_a_process_without_packet_sockets_has_none() -> None:
    assert packet_sockets(os.getpid()) == []
    with held(os.getpid()):
        pass


def test_a_process_that_is_gone_has_none() -> None:
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait(SOON_S)
    assert taken(ended.pid) == []


def test_all_descriptors_are_closed() -> None:
    pairs = [socket.socketpair() for _ in range(100)]
    close([theirs.detach() for _ours, theirs in pairs])
    for ours, _theirs in pairs:
        assert ours.recv(1) == b""  # its other end is closed
        ours.close()
