"""Programs: started, watched and ended by their own handle."""

import os
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest
from limits import SOON_S

from topologies.system.processes.programs import (
    WITH_RUNNER,
    NetworkError,
    Program,
    find_tools,
    stop_all,
)


def program(folder: Path, code: str, name: str = "clock") -> Program:
    started = Program(name, folder / f"{name}.log")
    started.start([sys.executable, "-c", code])
    return started


def test_what_it_prints_is_waited_for_and_it_ends_when_told(tmp_path: Path) -> None:
    sleeper = program(tmp_path, "print('ready', flush=True); import time; time.sleep(60)")
    sleeper.wait_for("ready", SOON_S)
    assert sleeper.running
    sleeper.stop()
    assert not sleeper.running
    assert sleeper.status == -15


FAULT = "import sys; from programs.faults import report_fault; sys.exit(report_fault({!r}))"


def test_one_that_ends_at_its_start_is_named_with_its_fault(tmp_path: Path) -> None:
    broken = program(tmp_path, FAULT.format("the spring is broken"))
    with pytest.raises(NetworkError, match="clock ended at its start: the spring is broken"):
        broken.wait_for("ready", SOON_S)


def test_one_that_is_killed_at_its_start_is_said_to_be(tmp_path: Path) -> None:
    killed = program(tmp_path, "import os; print('hello', flush=True); os.kill(os.getpid(), 9)")
    with pytest.raises(NetworkError, match="clock ended at its start: killed by SIGKILL"):
        killed.wait_for("ready", SOON_S)


COMPUTES = """
import os, time
os.sched_setaffinity(0, {%d})
while time.process_time() < %g:
    pass
print("ready", flush=True)
"""


def test_time_without_a_processor_does_not_count_as_waiting(tmp_path: Path) -> None:
    """Four programs on one processor have a quarter of it each: .25 s takes 1 s, and not .5 s."""
    own = min(os.sched_getaffinity(0))
    busy = [program(tmp_path, COMPUTES % (own, 60), f"busy-{number}") for number in range(3)]
    began = time.monotonic()
    slow = program(tmp_path, COMPUTES % (own, 0.25))
    try:
        slow.wait_for("ready", 0.5)
        assert time.monotonic() - began > 0.5
    finally:
        stop_all([slow, *busy])


def test_a_wait_names_what_it_waited_for(tmp_path: Path) -> None:
    silent = program(tmp_path, "import time; time.sleep(60)")
    try:
        with pytest.raises(NetworkError, match=r"clock was not ready in 0\.1 s.*clock\.log"):
            silent.wait_for("ready", 0.1)
    finally:
        silent.stop()


def test_one_that_ignores_the_signal_is_ended_by_force(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("topologies.system.processes.programs.STOP_TIMEOUT_S", 0.2)
    deaf = program(
        tmp_path,
        "import signal, time; signal.signal(signal.SIGTERM, signal.SIG_IGN);"
        "print('ready', flush=True); time.sleep(60)",
    )
    deaf.wait_for("ready", SOON_S)
    deaf.stop()
    assert deaf.status == -9


def test_one_that_has_work_to_end_is_waited_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Half a second of a processor is more than one wait, here of .4 s."""
    monkeypatch.setattr("topologies.system.processes.programs.STOP_TIMEOUT_S", 0.4)
    monkeypatch.setattr("topologies.system.processes.programs.STOP_WAITS", 1000)
    code = """
import signal, sys, time
def write(*_words):
    while time.process_time() < begun + 0.5:
        pass
    sys.exit(7)
begun = time.process_time()
signal.signal(signal.SIGTERM, write)
print("ready", flush=True)
time.sleep(60)
"""
    writing = program(tmp_path, code)
    writing.wait_for("ready", SOON_S)
    writing.stop()
    assert writing.status == 7


def test_all_are_ended_together_also_those_never_started(tmp_path: Path) -> None:
    both = [program(tmp_path, "import time; time.sleep(60)", name) for name in ("a", "b")]
    stop_all([*both, Program("never", tmp_path / "never.log")])
    assert not any(one.running for one in both)


def test_it_keeps_the_descriptors_that_it_is_given(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        address, number = listener.getsockname(), listener.fileno()
        code = f"import socket; socket.socket(fileno={number}).accept()[0].sendall(b'here')"
        keeper = Program("keeper", tmp_path / "keeper.log")
        keeper.start([sys.executable, "-c", code], descriptors=[number])
    with socket.create_connection(address, timeout=SOON_S) as connection:
        assert connection.recv(16) == b"here"
    keeper.stop()


def fails(folder: Path, code: str) -> str:
    """Return the message on the end of a program that was well at first."""
    failed = program(folder, f"print('ready', flush=True)\n{code}")
    failed.wait_for("ready", SOON_S)
    while failed.running:
        pass
    return failed.end()


@pytest.mark.parametrize(
    ("code", "cause"),
    [
        ("raise ValueError('the cat is dead')", "ValueError: the cat is dead"),
        ("raise RuntimeError", "RuntimeError"),
        (FAULT.format("no light"), "no light"),
        ("print('fault: no light'); print('later'); exit(1)", "no light"),
        (
            "raise ExceptionGroup('unhandled', [OSError('one'), ValueError('the last')])",
            "ValueError: the last",
        ),
        (
            "try:\n  1 / 0\nexcept ZeroDivisionError as error:\n"
            "  raise KeyError('behind it') from error",
            "KeyError: 'behind it'",
        ),
    ],
)
def test_the_cause_of_an_end_is_the_error_and_no_frame_around_it(
    tmp_path: Path, code: str, cause: str
) -> None:
    assert fails(tmp_path, code) == cause


def test_any_other_line_of_a_log_is_no_cause(tmp_path: Path) -> None:
    log = tmp_path / "clock.log"
    assert fails(tmp_path, "import sys; sys.exit(3)") == f"status 3; its log: {log}"
    assert fails(tmp_path, "import sys; sys.exit('all is well')") == f"status 1; its log: {log}"
    report = f"it ended by itself or by SIGTERM; its log: {log}"
    assert fails(tmp_path, "") == report


def test_the_log_of_a_program_that_is_not_ours_is_no_cause(tmp_path: Path) -> None:
    """The last line of tcpdump when its interface has gone: tcpdump.c, print_statistics."""
    log = tmp_path / "tcpdump.log"
    capture = Program("tcpdump", log)
    capture.start(["sh", "-c", "echo '0 packets dropped by kernel' >&2; exit 1"])
    assert capture._process is not None
    capture._process.wait(SOON_S)
    assert (capture.end(), capture.crash()) == (f"status 1; its log: {log}", "")


@pytest.mark.parametrize(
    ("code", "error"),
    [("raise OSError(28, 'No space left')", "OSError: [Errno 28] No space left"), ("exit(1)", "")],
)
def test_an_error_that_is_not_handled_is_a_crash(tmp_path: Path, code: str, error: str) -> None:
    failed = program(tmp_path, code)
    assert failed._process is not None
    failed._process.wait(SOON_S)
    assert failed.crash() == error


def test_a_program_that_is_started_again_is_ready_when_it_says_so_again(tmp_path: Path) -> None:
    clock = program(tmp_path, "print('ready', flush=True)")
    clock.wait_for("ready", SOON_S)
    clock.stop()
    clock.start([sys.executable, "-c", FAULT.format("rusty")])
    with pytest.raises(NetworkError, match="clock ended at its start: rusty"):
        clock.wait_for("ready", SOON_S)


def test_one_that_is_stopped_by_a_signal_is_noticed_and_ends_when_told(tmp_path: Path) -> None:
    sleeper = program(tmp_path, "print('ready', flush=True); import time; time.sleep(60)")
    sleeper.wait_for("ready", SOON_S)
    assert not sleeper.stopped
    pid = pid_of(sleeper)
    os.kill(pid, signal.SIGSTOP)
    os.waitid(os.P_PID, pid, os.WSTOPPED | os.WNOWAIT)
    assert sleeper.stopped
    sleeper.stop()
    assert sleeper.status == -signal.SIGTERM


def pid_of(started: Program) -> int:
    assert started._process is not None
    return started._process.pid


@pytest.mark.parametrize("is_there", [True, False])
def test_it_begins_only_while_its_runner_is_there(is_there: bool) -> None:
    """The kernel ends it with the runner, but only if the runner lives when it is asked to."""
    runner = os.getpid() if is_there else 1
    command = [*WITH_RUNNER, str(runner), "echo", "begun"]
    done = subprocess.run(command, capture_output=True, check=False, timeout=SOON_S)
    assert (done.stdout, done.returncode) == ((b"begun\n", 0) if is_there else (b"", 1))


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ("/usr/bin:/bin", "/usr/bin:/bin:/usr/local/sbin:/usr/sbin:/sbin"),  # as su leaves it
        ("/usr/sbin:/own", "/usr/sbin:/own:/usr/local/sbin:/sbin"),
        ("", f"{os.defpath}:/usr/local/sbin:/usr/sbin:/sbin"),  # no working directory
    ],
)
def test_tools_of_root_are_found_behind_all_else(
    monkeypatch: pytest.MonkeyPatch, before: str, after: str
) -> None:
    monkeypatch.setenv("PATH", before)
    for _ in range(2):
        find_tools()
        assert os.environ["PATH"] == after
