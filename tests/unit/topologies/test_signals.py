"""Signals become an exception at the next check."""

import os
import signal
import socket
import subprocess
import threading

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


def test_what_fails_because_of_a_signal_is_reported_as_the_signal() -> None:
    def fail() -> None:
        os.kill(os.getpid(), signal.SIGINT)
        raise OSError("a command was ended by SIGINT")

    with pytest.raises(Interrupted, match="SIGINT") as caught, Signals():
        fail()
    assert isinstance(caught.value.__cause__, OSError)


def test_what_fails_without_a_signal_stays_what_it_is() -> None:
    with pytest.raises(OSError, match="full"), Signals():
        raise OSError("the disk is full")


def test_nothing_cuts_short_what_defers_signals_nor_its_commands() -> None:
    with Signals() as signals:
        with signals.deferred():
            subprocess.run(["sh", "-c", "kill -INT $$"], check=True)
            os.kill(os.getpid(), signal.SIGTERM)
            signals.check()
        with pytest.raises(Interrupted, match="SIGTERM"):
            signals.check()


def test_a_signal_that_another_thread_takes_is_deferred_too(
    request: pytest.FixtureRequest,
) -> None:
    taken, arrives = socket.socketpair()
    arrives.setblocking(False)
    request.addfinalizer(taken.close)
    request.addfinalizer(arrives.close)
    done = threading.Event()
    thread = threading.Thread(target=done.wait)
    thread.start()
    before = signal.set_wakeup_fd(arrives.fileno())
    try:
        with Signals() as signals:
            with signals.deferred():
                os.kill(os.getpid(), signal.SIGTERM)
                taken.settimeout(10)
                assert taken.recv(1) == bytes([signal.SIGTERM])
                signals.check()
            with pytest.raises(Interrupted, match="SIGTERM"):
                signals.check()
    finally:
        signal.set_wakeup_fd(before)
        done.set()
        thread.join()


def test_signals_that_count_at_once_interrupt_or_end_what_is_being_done() -> None:
    with Signals() as signals:
        with signals.at_once():
            with pytest.raises(KeyboardInterrupt):
                os.kill(os.getpid(), signal.SIGINT)
            signals.check()  # Ctrl-C ends what is being done, and not the network
            with pytest.raises(Interrupted, match="SIGTERM"):
                os.kill(os.getpid(), signal.SIGTERM)
            with pytest.raises(Interrupted, match="SIGTERM"):
                signals.check()
        os.kill(os.getpid(), signal.SIGINT)  # noted again, for the next check
