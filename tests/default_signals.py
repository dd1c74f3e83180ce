"""Tests take signals as a program at a terminal does, however pytest was started: a plug-in."""

import signal

ENDING = (signal.SIGINT, signal.SIGQUIT, signal.SIGHUP, signal.SIGTERM)


def pytest_configure() -> None:
    """Take signals again that a shell's `&` or `nohup` has ignored; children inherit that."""
    for number in ENDING:
        if signal.getsignal(number) is signal.SIG_IGN:
            default = signal.default_int_handler if number == signal.SIGINT else signal.SIG_DFL
            signal.signal(number, default)
