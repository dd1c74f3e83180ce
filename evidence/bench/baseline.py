"""The cost of the same network without light: TCP connects and packet-ins, timed on a host.

python -m evidence.bench.baseline serve ADDRESS
python -m evidence.bench.baseline connects COUNT ADDRESS      seconds for one TCP connect and close
python -m evidence.bench.baseline packet-ins COUNT BROADCAST  seconds for a packet-in and -out
"""

import argparse
import select
import socket
import time

from qmn.timeouts import TURN_TIMEOUT_S

PORT = 9011


def serve(address: str) -> None:
    """Accept and close connections, and answer datagrams, until killed."""
    listener = socket.create_server((address, PORT), backlog=64)
    datagrams = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    datagrams.bind(("", PORT))
    print("ready", flush=True)
    while True:
        readable, _, _ = select.select([listener, datagrams], [], [])
        if listener in readable:
            connection, _peer = listener.accept()
            connection.recv(1)
            connection.close()
        if datagrams in readable:
            datagrams.sendto(*datagrams.recvfrom(16))


def connects(count: int, address: str) -> float:
    started = time.perf_counter()
    for _ in range(count):
        with socket.create_connection((address, PORT), TURN_TIMEOUT_S) as connection:
            connection.shutdown(socket.SHUT_WR)
            connection.recv(1)
    return (time.perf_counter() - started) / count


def packet_ins(count: int, broadcast: str) -> float:
    """Return the mean time from a datagram that no entry matches to its answer.

    A broadcast is never learned, so each goes to the controller and back once; the answer
    is unicast and stays in the switch.
    """
    asker = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    asker.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)
    asker.settimeout(TURN_TIMEOUT_S)
    started = time.perf_counter()
    for number in range(count):
        asker.sendto(number.to_bytes(4, "big"), (broadcast, PORT))
        asker.recvfrom(16)
    return (time.perf_counter() - started) / count


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m evidence.bench.baseline", description=__doc__)
    verbs = parser.add_subparsers(dest="verb", required=True)
    verbs.add_parser("serve").add_argument("address")
    for verb in ("connects", "packet-ins"):
        measure = verbs.add_parser(verb)
        measure.add_argument("count", type=int)
        measure.add_argument("address")
    arguments = parser.parse_args()
    if arguments.verb == "serve":
        serve(arguments.address)
    measures = {"connects": connects, "packet-ins": packet_ins}
    print(f"seconds {measures[arguments.verb](arguments.count, arguments.address):.9f}", flush=True)


if __name__ == "__main__":
    main()
