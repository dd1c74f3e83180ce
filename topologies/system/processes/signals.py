"""Signals that ask a run to end: noted, and raised where it can be ended in order.

Those that tell of a fault of the program, and SIGKILL, end it at once.
"""

import os
import signal
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from types import FrameType
from typing import ClassVar, Self

from topologies.system.processes.programs import NetworkError
from topologies.timeouts import AGAIN_S, OVERRUN_S

# Notes of what has ended a run; the first also begins the words of NotCleanedUp.
UNCLEANED, CLEANED = "cleaning up: ", "everything is cleaned up"


class Interrupted(Exception):
    """The user, or the system, has asked the run to end."""

    def __init__(self, number: int) -> None:
        super().__init__(f"interrupted by {signal.Signals(number).name}")
        self.status = 128 + number


class NotCleanedUp(NetworkError):
    """Not all that a network has made could be taken away again; the words say why."""

    def __init__(self, why: object) -> None:
        super().__init__(f"{UNCLEANED}{why}")


def interrupted_words(error: Interrupted | KeyboardInterrupt) -> str:
    """Return what ended the run, and whether a network was cleaned up or why not, line by line."""
    notes: list[str] = getattr(error, "__notes__", [])
    ended = str(error) or "interrupted"
    if CLEANED in notes:
        ended = f"{ended}; {CLEANED}"
    return "\n".join([ended, *(note for note in notes if note != CLEANED)])


class Signals:
    """Turns signals into an exception at the next check, never in the middle of a step.

    A second one of a person who will not wait ends the process at once, and with it all that the
    run has started.
    """

    OF_TERMINAL = (signal.SIGINT, signal.SIGQUIT, signal.SIGHUP)
    NUMBERS = (*OF_TERMINAL, signal.SIGTERM)  # unless the caller ignores them, as nohup does
    # They end a program that has no other use for them, as tests have for SIGALRM.
    OTHERS = (
        *(signal.SIGUSR1, signal.SIGUSR2, signal.SIGALRM, signal.SIGVTALRM, signal.SIGPROF),
        *(signal.SIGXCPU, signal.SIGIO, signal.SIGPWR),
    )
    NOT_IMPATIENT = (signal.SIGHUP, *OTHERS)  # a shell passes its terminal's SIGHUP on, too
    current: ClassVar["Signals | None"] = None

    def __enter__(self) -> Self:
        self._received: int | None = None
        self._received_at = 0.0
        self._deferring = False
        self._previous = {number: signal.signal(number, self._note) for number in _free()}
        self._outer, Signals.current = Signals.current, self
        return self

    def _note(self, number: int, _frame: FrameType | None) -> None:
        if self._received is None:
            self._received, self._received_at = number, time.monotonic()
        elif number not in self.NOT_IMPATIENT and self.came_before(AGAIN_S):
            force_end(number)

    def came_before(self, duration_s: float = 0.0) -> bool:
        return self._received is not None and time.monotonic() - self._received_at >= duration_s

    def check(self) -> None:
        """Raise Interrupted if a signal has come, unless signals are deferred."""
        if self._received is not None and not self._deferring:
            raise Interrupted(self._received)

    @contextmanager
    def deferred(self) -> Iterator[None]:
        """Let one signal not cut a piece of work short.

        It counts afterwards: another network may be about to start. Commands that shall not be
        cut short either need a session of their own, which a terminal's Ctrl-C does not reach.
        """
        self._deferring = True
        try:
            yield
        finally:
            self._deferring = False

    @contextmanager
    def at_once(self) -> Iterator[None]:
        """Let Ctrl-C interrupt what is being done (KeyboardInterrupt), and other signals end it.

        For a person at the keyboard, or a script, who waits without checks.
        """
        for number in self._previous:
            ctrl_c = number == signal.SIGINT
            signal.signal(number, signal.default_int_handler if ctrl_c else self._raise)
        try:
            yield
        finally:
            for number in self._previous:
                signal.signal(number, self._note)

    def _raise(self, number: int, frame: FrameType | None) -> None:
        self._note(number, frame)  # for the next check, if somebody swallows what is raised
        self.check()

    def __exit__(self, _kind: object, error: BaseException | None, _trace: object) -> None:
        Signals.current = self._outer
        for number, handler in self._previous.items():
            signal.signal(number, handler)
        if isinstance(error, Exception) and not isinstance(error, Interrupted):
            self._check_cause(error)

    def _check_cause(self, error: Exception) -> None:
        """A terminal's Ctrl-C also ends the commands that run just then: say so instead."""
        if self._received is not None:
            interrupted = Interrupted(self._received)
            uncleaned = [str(error)] if isinstance(error, NotCleanedUp) else []
            for note in (*uncleaned, *getattr(error, "__notes__", ())):
                interrupted.add_note(note)
            raise interrupted from error


@contextmanager
def budget(limit_s: float, what: str) -> Iterator[None]:
    """Raise NetworkError if something takes longer, also when it consists of many waits.

    Steps that go on after that get OVERRUN_S each. Only the main thread can
    be interrupted so.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def overrun(_number: int, frame: FrameType | None) -> None:
        where = f"{frame.f_code.co_filename}:{frame.f_lineno}" if frame else "somewhere"
        raise NetworkError(f"{what} did not end in {limit_s:g} s: it waited at {where}")

    before = signal.signal(signal.SIGALRM, overrun)
    signal.setitimer(signal.ITIMER_REAL, limit_s, OVERRUN_S)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


def _free() -> Iterator[int]:
    for number in Signals.NUMBERS:
        if signal.getsignal(number) is not signal.SIG_IGN:
            yield number
    for number in Signals.OTHERS:
        if signal.getsignal(number) is signal.SIG_DFL:
            yield number


def reset() -> None:
    """Let signals end this process as any other: a fork of one that has taken them."""
    for number in (*Signals.NUMBERS, *Signals.OTHERS):
        signal.signal(number, signal.SIG_DFL)


def force_end(number: int) -> None:
    """End this process now; nothing that it is about to do is done."""
    text = (
        f"qmn: a second {signal.Signals(number).name} has forced the end; the kernel ends what is "
        "left\n"
    )
    with suppress(OSError):
        os.write(sys.stderr.fileno(), text.encode())
    os._exit(128 + number)
