"""Waits of emulation tests."""

import time
from collections.abc import Callable
from pathlib import Path

from limits import SOON_S

ROOT = Path(__file__).resolve().parents[2]


def wait_until(condition: Callable[[], object], what: str, timeout_s: float = SOON_S) -> None:
    """Wait for a condition; fail naming it when the deadline passes."""
    deadline = time.monotonic() + timeout_s
    while not condition():
        assert time.monotonic() < deadline, f"not in {timeout_s:g} s: {what}"
        time.sleep(0.02)
