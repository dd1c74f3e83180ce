"""Ctrl-C ends tests in order."""

import signal

import default_signals
import pytest


@pytest.mark.parametrize("handler", [signal.SIG_IGN, signal.SIG_DFL])
def test_ctrl_c_is_an_interrupt_whatever_was_set_before(handler: signal.Handlers) -> None:
    before = signal.signal(signal.SIGINT, handler)
    try:
        default_signals.pytest_collection_finish()
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
    finally:
        signal.signal(signal.SIGINT, before)


def test_a_handler_of_ones_own_stays() -> None:
    before = signal.signal(signal.SIGTERM, lambda *_: None)
    try:
        own = signal.getsignal(signal.SIGTERM)
        default_signals.pytest_collection_finish()
        assert signal.getsignal(signal.SIGTERM) is own
    finally:
        signal.signal(signal.SIGTERM, before)
