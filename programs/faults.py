"""The fault that ends one of our programs: one line on stderr, which the runner of a network reads.

Any other line of a log may be the last by chance, and is no cause.
"""

import sys

MARK = "fault: "


def report_fault(fault: str) -> int:
    """Print the fault of a program; return its exit status."""
    print(f"{MARK}{fault}", file=sys.stderr, flush=True)
    return 1


def reported_fault(output: str) -> str:
    """Return the last fault in the output of a program, "" without any."""
    faults = [line.removeprefix(MARK) for line in output.splitlines() if line.startswith(MARK)]
    return faults[-1] if faults else ""
