"""Signals become an exception at the next check."""

import os
import signal

import pytest

from topologies.network import Interrupted, Signals


@pytest.mark.parametrize("number", Signals.NUMBERS)
def test_a_signal_is_raised_at_the_next_check_and_not_before(number: signal.Signals) -> None:
    with Signals() as signals:
        signals.check()
        os.kill(os.getpid(), number)
        with pytest.raises(Interrupted, match=number.name) as caught:
            signals.check()
    assert caught.value.status == 128 + number


def test_the_handlers_of_before_are_put_back() -> None:
    before = [signal.getsignal(number) for number in Signals.NUMBERS]
    with Signals():
        assert signal.getsignal(signal.SIGINT) != before[0]
    assert [signal.getsignal(number) for number in Signals.NUMBERS] == before
