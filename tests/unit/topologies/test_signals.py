"""Signals become an exception at the next check."""

import os
import signal
import socket
import subprocess
import sys
import threading
import time
from contextlib import ExitStack, suppress

import pytest
from limits import SOON_S

from topologies.system.processes import signals as signals_module
from topologies.system.processes.programs import NetworkError
from topologies.system.processes.signals import (
    CLEANED,
    UNCLEANED,
    Interrupted,
    NotCleanedUp,
    Signals,
    budget,
    interrupted_words,
)


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


@pytest.mark.parametrize("signalled", [False, True])
def test_who_is_interrupted_hears_of_what_could_not_be_cleaned_up(signalled: bool) -> None:
    why = NotCleanedUp("ovsdb-server does not answer")

    def fail() -> None:
        if signalled:
            os.kill(os.getpid(), signal.SIGTERM)
        raise why

    with pytest.raises((Interrupted, NotCleanedUp)) as caught, Signals():
        fail()
    if signalled:
        assert isinstance(caught.value, Interrupted)
        assert interrupted_words(caught.value) == (
            "interrupted by SIGTERM\ncleaning up: ovsdb-server does not answer"
        )
    else:
        assert caught.value is why


def test_only_what_was_cleaned_up_is_reported_to_be() -> None:
    assert interrupted_words(KeyboardInterrupt()) == "interrupted"
    assert interrupted_words(Interrupted(signal.SIGHUP)) == "interrupted by SIGHUP"
    ended = Interrupted(signal.SIGHUP)
    ended.add_note(CLEANED)
    ended.add_note("report to look at: r.html")
    assert interrupted_words(ended) == (
        "interrupted by SIGHUP; everything is cleaned up\nreport to look at: r.html"
    )


@pytest.mark.parametrize("note", [CLEANED, f"{UNCLEANED}q1 stays"])
def test_a_fault_that_a_signal_explains_keeps_what_clean_up_noted(note: str) -> None:
    fault = OSError("a command was ended")
    fault.add_note(note)

    def fail() -> None:
        os.kill(os.getpid(), signal.SIGTERM)
        raise fault

    with pytest.raises(Interrupted) as caught, Signals():
        fail()
    assert caught.value.__notes__ == [note]


TAKES = """
import os, sys
from topologies.system.processes.signals import Interrupted, Signals
number = int(sys.argv[1])
try:
    with Signals() as signals:
        os.kill(os.getpid(), number)
        os.kill(os.getpid(), number)
        signals.check()
        print("goes on")
except Interrupted as error:
    print(error)
"""


@pytest.mark.parametrize("number", [*Signals.NUMBERS, *Signals.OTHERS])
def test_every_signal_that_would_end_a_process_asks_a_run_to_end(number: signal.Signals) -> None:
    command = [sys.executable, "-c", TAKES, str(int(number))]
    done = subprocess.run(command, capture_output=True, text=True, timeout=SOON_S, check=False)
    assert (done.returncode, done.stdout) == (0, f"interrupted by {number.name}\n")


def test_a_signal_that_the_caller_has_ignored_stays_ignored() -> None:
    """As `nohup` (POSIX) has SIGHUP ignored."""
    command = ["nohup", sys.executable, "-c", TAKES, str(int(signal.SIGHUP))]
    done = subprocess.run(command, capture_output=True, text=True, timeout=SOON_S, check=False)
    assert (done.returncode, done.stdout) == (0, "goes on\n")


def test_what_fails_without_a_signal_stays_what_it_is() -> None:
    with pytest.raises(OSError, match="full"), Signals():
        raise OSError("the disk is full")


def test_a_signal_does_not_cut_short_what_defers_it() -> None:
    with Signals() as signals:
        with signals.deferred():
            os.kill(os.getpid(), signal.SIGTERM)
            signals.check()
        with pytest.raises(Interrupted, match="SIGTERM"):
            signals.check()


HANGS = """
import time
from topologies.system.processes.signals import Signals
with Signals() as signals, signals.deferred():
    print("cleaning up", flush=True)
    time.sleep(60)
"""


def test_a_second_signal_forces_the_end_of_what_hangs() -> None:
    with subprocess.Popen(
        [sys.executable, "-c", HANGS], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        assert process.stdout.readline() == "cleaning up\n"
        deadline = time.monotonic() + SOON_S
        while process.poll() is None and time.monotonic() < deadline:
            process.send_signal(signal.SIGINT)
            with suppress(subprocess.TimeoutExpired):
                process.wait(0.1)
        process.kill()
        words = process.stderr.read()
    assert process.returncode == 128 + signal.SIGINT
    assert "a second SIGINT has forced the end" in words
    assert "the kernel ends what is left" in words


def test_a_signal_that_is_sent_twice_at_once_counts_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """As `timeout` does: to the process, and to its group."""
    monkeypatch.setattr("topologies.system.processes.signals.AGAIN_S", 3600.0)
    with Signals() as signals:
        for _ in range(2):
            os.kill(os.getpid(), signal.SIGTERM)
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


def test_many_waits_together_have_a_budget_and_each_step_after_it_a_moment(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Of four steps that each wait for long, none is left out."""
    monkeypatch.setattr(signals_module, "OVERRUN_S", 0.05)
    began, steps = time.monotonic(), []

    def step(number: int) -> None:
        steps.append(number)
        time.sleep(SOON_S)

    with ExitStack() as stack:
        for number in range(4):
            stack.callback(step, number)
        left = stack.pop_all()
    words = r"^clean-up did not end in 0\.1 s: it waited at .*py:"
    with budget(0.1, "clean-up"), pytest.raises(NetworkError, match=words):
        left.close()
    assert steps == [3, 2, 1, 0]
    assert time.monotonic() - began < SOON_S
    assert signal.getitimer(signal.ITIMER_REAL) == (0, 0)


def test_what_is_within_its_budget_is_left_alone() -> None:
    before = signal.getsignal(signal.SIGALRM)
    with budget(60, "clean-up"):
        pass
    assert signal.getsignal(signal.SIGALRM) is before
    assert signal.getitimer(signal.ITIMER_REAL) == (0, 0)
