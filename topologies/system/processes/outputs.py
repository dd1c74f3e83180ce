"""Standard output and error of every verb: a write that fails ends the verb in order.

The first failed write to standard output raises LostOutput in the main thread. Later writes, and
failed ones to standard error, are dropped, so that clean-up goes on. The exit status is then not 0.
"""

import errno
import io
import os
import select
import signal
import sys
import threading
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, TextIO

from topologies.system.processes.signals import Signals
from topologies.timeouts import AGAIN_S, OUTPUT_LOOK_S, OUTPUT_TIMEOUT_S

if TYPE_CHECKING:
    from _typeshed import ReadableBuffer

STDIN, STDOUT, STDERR = range(3)


class LostOutput(Exception):
    """Standard output cannot be written; the text says why.

    It is no OSError: those are about files, and callers that expect one would catch this.
    """

    def __init__(self, why: OSError) -> None:
        super().__init__(f"standard output cannot be written: {why.strerror}")
        self.reader_gone = why.errno == errno.EPIPE  # as `head` does; no error then


class Output(io.FileIO):
    """One of the two standard outputs; `lost` says why it cannot be written any more."""

    def __init__(self, descriptor: int) -> None:
        super().__init__(descriptor, "w", closefd=False)
        self.lost: LostOutput | None = None
        self._raises = descriptor == STDOUT  # nobody would read of a lost standard error
        self._poll = select.poll()
        self._poll.register(descriptor, select.POLLOUT)

    def write(self, data: "ReadableBuffer", /) -> int:
        """Write all of it, or raise LostOutput once, in the main thread."""
        whole = memoryview(data).cast("B")
        if self.lost is None:
            try:
                self._write_all(whole)
            except OSError as error:
                self.lost = LostOutput(error)
        if self.lost and self._raises and threading.current_thread() is threading.main_thread():
            self._raises = False
            if Signals.current:
                Signals.current.check()  # the SIGHUP of a terminal that has gone is the cause
            raise self.lost
        return len(whole)

    def _write_all(self, left: memoryview) -> None:
        while left:
            self._await_reader()
            # A pipe that is ready takes so much at once.
            written = super().write(left[: select.PIPE_BUF])
            left = left[written or 0 :]

    def _await_reader(self) -> None:
        """Wait while a pipe or a terminal is full; raise TimeoutError if it stays so."""
        deadline = time.monotonic() + OUTPUT_TIMEOUT_S
        while not self._poll.poll(1e3 * OUTPUT_LOOK_S):
            asked_to_end = Signals.current and Signals.current.came_before(AGAIN_S)
            if asked_to_end or time.monotonic() > deadline:
                raise TimeoutError(errno.ETIMEDOUT, "nobody reads it")


def with_outputs(work: Callable[[], int]) -> int:
    """Do the work; return its exit status, which is not 0 if an output was lost."""
    outputs = take_outputs()
    try:
        try:
            status = work()
        finally:
            sys.stdout.flush()
    except LostOutput as error:
        if error.reader_gone:
            return 128 + signal.SIGPIPE
        print(f"qmn: {error}", file=sys.stderr)
        return 1
    return status or int(any(output.lost for output in outputs))


def take_outputs() -> list[Output]:
    """Let this program write by Outputs alone; return them."""
    open_closed()
    outputs = [Output(descriptor) for descriptor in (STDOUT, STDERR)]
    sys.stdout, sys.stderr = map(_stream, outputs, (sys.stdout, sys.stderr))
    sys.stdin = sys.stdin or os.fdopen(STDIN, closefd=False)
    return outputs


def open_closed() -> None:
    """Let no file that is opened later become a standard one: reading gives nothing there."""
    while (descriptor := os.open(os.devnull, os.O_RDONLY)) <= STDERR:
        os.set_inheritable(descriptor, True)
    os.close(descriptor)


def _stream(output: Output, before: TextIO | None) -> TextIO:
    unbuffered = isinstance(before, io.TextIOWrapper) and before.write_through
    return io.TextIOWrapper(
        output if unbuffered else io.BufferedWriter(output),
        encoding=before.encoding if before else "utf-8",
        errors=before.errors if before else "backslashreplace",
        line_buffering=output.isatty() or output.fileno() == STDERR,
        write_through=unbuffered,
    )


def forget_no_width() -> None:
    """Forget a width of the terminal that is none, as COLUMNS=0: nothing would be shown."""
    columns = os.environ.get("COLUMNS", "1")
    if not (columns.isdecimal() and int(columns)):
        del os.environ["COLUMNS"]
