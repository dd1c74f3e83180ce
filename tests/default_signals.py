"""Tests take signals as a program at a terminal does, however pytest was started: a plug-in."""

import signal
from typing import Any

DEFAULTS: dict[signal.Signals, Any] = {
    signal.SIGINT: signal.default_int_handler,
    **dict.fromkeys((signal.SIGQUIT, signal.SIGHUP, signal.SIGTERM), signal.SIG_DFL),
}


def pytest_configure() -> None:
    """Take signals again that a shell's `&` or `nohup` has ignored; children inherit that."""
    for number, default in DEFAULTS.items():
        if signal.getsignal(number) in (signal.SIG_IGN, signal.SIG_DFL):
            signal.signal(number, default)


def pytest_collection_finish() -> None:
    """Have Ctrl-C end tests in order: programs that they import have it end the process."""
    pytest_configure()
