"""Memory that has been freed stays with the process, in a process of its own."""

import subprocess
import sys

from limits import SOON_S

COUNT_FAULTS = """
import ctypes
import resource
import sys

import numpy as np

from dispatcher import build

PR_SET_THP_DISABLE = 41  # huge pages would hide how many small ones are cleared
assert ctypes.CDLL(None).prctl(PR_SET_THP_DISABLE, 1, 0, 0, 0) == 0
if sys.argv[1] == "kept":
    assert build.keep_freed_memory()
before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
for _ in range(50):
    np.ones(250_000) + np.ones(250_000)
print(resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before)
"""


def page_faults(how: str) -> int:
    """Return how many pages the system has to clear for arrays that are taken again and again."""
    command = [sys.executable, "-c", COUNT_FAULTS, how]
    return int(subprocess.run(command, check=True, capture_output=True, timeout=SOON_S).stdout)


def test_arrays_are_taken_again_without_the_system_clearing_their_pages() -> None:
    assert page_faults("kept") < page_faults("given back") / 10
