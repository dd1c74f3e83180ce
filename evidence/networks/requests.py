"""Requests for light, some at a time and for ever, by a host, without any light.

python -m evidence.networks.requests RECEIVER SOURCE

Nobody listens at the receiver's port, which refuses a session only after the controller has
granted it; the next one begins when that is heard. Those that ask at the same time find the fibre
taken, which the controller has to find out as well. Prints how many there were so far.
"""

import sys
import time
from collections.abc import Iterator
from contextlib import suppress
from itertools import count
from threading import Thread

from evidence.bench.path_requests import NoPath, ask
from wire.metadata.vocabulary import Service

AT_A_TIME = 4


def main() -> None:
    """Ask until somebody ends it."""
    receiver, source = sys.argv[1:]
    first, numbers = time.time_ns(), count(1)
    print("ready", flush=True)
    for _ in range(AT_A_TIME):
        Thread(target=go_on, args=(receiver, source, first, numbers)).start()


def go_on(receiver: str, source: str, first: int, numbers: Iterator[int]) -> None:
    """Ask again and again; a request that is refused for want of light was one, too."""
    for number in numbers:
        with suppress(NoPath):
            ask(first + number, receiver, source, Service.BB84).close()
        print(number, flush=True)


if __name__ == "__main__":
    main()
