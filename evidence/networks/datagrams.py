"""Datagrams of one size at random times between two hosts, and how long each was on its way.

    python -m evidence.networks.datagrams FOLDER hear             prints the times of each, in ns
    python -m evidence.networks.datagrams FOLDER say 10.0.0.2 --per-s 20 --frame-bytes 1250

They come as a Poisson process; both hosts have one clock, which the gate of the folder steps.
"""

import argparse
import random
import socket
import struct
from collections.abc import Iterator

from programs.network_waits import NetworkWaits
from wire.network_time import SteppedTime

PORT = 10_009
HEADERS_BYTES = 14 + 20 + 8  # of Ethernet, IPv4 and UDP
LEAST_FRAME_BYTES, MOST_FRAME_BYTES = 60, 1514
SENT_NS = struct.Struct("!Q")


def main() -> None:
    parser = argparse.ArgumentParser(prog="datagrams", description=__doc__)
    parser.add_argument("folder")
    verbs = parser.add_subparsers(dest="verb", required=True)
    verbs.add_parser("hear")
    say_parser = verbs.add_parser("say")
    say_parser.add_argument("address")
    say_parser.add_argument("--per-s", type=float, required=True)
    say_parser.add_argument("--frame-bytes", type=int, required=True)
    say_parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    clock = SteppedTime(folder=arguments.folder)
    if arguments.verb == "hear":
        hear(clock)
    else:
        say(clock, arguments.address, arguments.per_s, arguments.frame_bytes, arguments.seed)


def hear(clock: SteppedTime) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as hearing:
        hearing.bind(("", PORT))
        print("ready", flush=True)
        while True:
            data = hearing.recv(MOST_FRAME_BYTES)
            came_ns = clock.now_ns()
            if len(data) >= SENT_NS.size:
                print(SENT_NS.unpack_from(data)[0], came_ns, flush=True)


def say(clock: SteppedTime, address: str, per_s: float, frame_bytes: int, seed: int) -> None:
    padding = bytes(frame_bytes - HEADERS_BYTES - SENT_NS.size)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as saying, NetworkWaits(clock) as waits:
        saying.connect((address, PORT))
        for gap_s in gaps_s(per_s, seed):
            waits.sleep(gap_s)
            saying.send(SENT_NS.pack(clock.now_ns()) + padding)


def gaps_s(per_s: float, seed: int) -> Iterator[float]:
    draws = random.Random(seed)  # noqa: S311
    while True:
        yield draws.expovariate(per_s)


if __name__ == "__main__":
    main()
