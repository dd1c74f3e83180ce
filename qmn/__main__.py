"""qmn: the Mininet for programmable quantum networks."""

import argparse
import os
import signal
import sys

# Until a verb runs there is nothing to clean up: Ctrl-C just ends the program.
signal.signal(signal.SIGINT, signal.SIG_DFL)

from qmn import (  # noqa: E402
    bench,
    calibrate,
    classical,
    clean,
    cli,
    curves,
    devices,
    doctor,
    fault,
    paths,
    policy,
    replay,
    report,
    run,
    sabot,
    set,  # noqa: A004
    spy,
    sweep,
    wireshark,
)

VERBS = (
    run,
    cli,
    sweep,
    curves,
    devices,
    paths,
    spy,
    wireshark,
    set,
    policy,
    fault,
    calibrate,
    classical,
    sabot,
    replay,
    report,
    doctor,
    clean,
    bench,
)


def main() -> int:
    """Find the verb, run it, and return its exit status."""
    parser = argparse.ArgumentParser(prog="qmn", description=__doc__)
    verbs = parser.add_subparsers(metavar="VERB", required=True)
    for verb in VERBS:
        verb.add_parser(verbs)
    arguments = parser.parse_args()
    try:
        status: int = arguments.call(arguments)
        sys.stdout.flush()
    except BrokenPipeError:
        # Whoever read our output has gone, as `head` does; there is nobody to tell.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 128 + signal.SIGPIPE
    return status


if __name__ == "__main__":
    sys.exit(main())
