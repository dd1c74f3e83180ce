"""Packet sockets of another process, held while that closes them."""

import os
import socket
import subprocess
import sys

from limits import SOON_S

from topologies.system.kernel.packet_sockets import close, packet_sockets, taken

HOLDS_THREE = """
import socket, sys
sockets = [socket.socket(socket.AF_PACKET, socket.SOCK_RAW) for _ in range(3)]
others = [socket.socket() for _ in range(3)]
print("ready", flush=True)
sys.stdin.readline()
"""


def test_packet_sockets_of_a_process_outlive_it_until_they_are_closed() -> None:
    holder = subprocess.Popen(
        [sys.executable, "-c", HOLDS_THREE], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    )
    assert holder.stdout is not None
    assert holder.stdout.readline() == b"ready\n"
    assert len(packet_sockets(holder.pid)) == 3
    mine = taken(holder.pid)
    holder.communicate(b"\n", timeout=SOON_S)
    assert len(mine) == 3
    for descriptor in mine:
        with socket.socket(fileno=os.dup(descriptor)) as held:
            assert held.family == socket.AF_PACKET
    assert sorted(packet_sockets(os.getpid())) == sorted(mine)
    close(mine)
    assert packet_sockets(os.getpid()) == []
