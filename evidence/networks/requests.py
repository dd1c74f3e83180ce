"""Requests for light, some at a time and for ever, by a host, without any light.

python -m evidence.networks.requests RECEIVER SOURCE

Nobody listens at the receiver's port, which refuses a session only after the controller has
granted it; the next one begins when that is heard. Those that ask at the same time find the fibre
taken, which the controller has to find out as well. Prints how many there were so far.
"""

import sys
from collections.abc import Iterator
from contextlib import suppress
from itertools import count
from threading import Thread

from evidence.bench.path_requests import NoPath, ask
from wire.metadata.vocabulary import Service

AT_A_TIME = 4


def main() -> None:
    receiver, source = sys.argv[1:]
    print("ready", flush=True)
    for first in range(AT_A_TIME):
        Thread(target=go_on, args=(receiver, source, count(first, AT_A_TIME))).start()


def go_on(receiver: str, source: str, numbers: Iterator[int]) -> None:
    """Ask again and again; a request that is refused for want of light was one, too."""
    for number in numbers:
        with suppress(NoPath):
            ask(number, receiver, source, Service["BB84"]).close()
        print(number, flush=True)


if __name__ == "__main__":
    main()
