"""Requests for light one after the other, for ever, by a host, without any light.

python -m qmn.emulated.requests RECEIVER SOURCE

Nobody listens at the receiver's port, which refuses a session only after the controller has
granted it; the next one begins when that is heard. Prints how many there were so far.
"""

import sys
import time
from contextlib import suppress

from qmn.benchmarks.path_requests import NoPath, ask


def main() -> None:
    """Ask until somebody ends it; a request that is refused for want of light was one, too."""
    receiver, source = sys.argv[1:]
    print("ready", flush=True)
    number, first = 0, time.time_ns()
    while True:
        number += 1
        with suppress(NoPath):
            ask(first + number, receiver, source).close()
        print(number, flush=True)


if __name__ == "__main__":
    main()
