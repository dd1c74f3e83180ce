"""Namespaces of a run: who keeps them, who runs in them, and what is left when one ends (root)."""

import fcntl
import os
import pty
import select
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path

import pytest
from limits import SOON_S, wait_until

from programs.connection_shares import users_of
from topologies.system import namespaces
from topologies.system.processes.programs import ROOT

pytestmark = pytest.mark.skipif(os.geteuid() != 0, reason="only root makes namespaces")
RUN = """
import os, sys
from pathlib import Path
from topologies.system import namespaces
from topologies.system.processes import owners
namespaces.RUNTIME_ROOT = Path(sys.argv[1])
status = namespaces.enter_new(["qmn", "run"])
if status is not None:
    sys.exit(status)
"""
SERVES = (
    RUN
    + """
listener = namespaces.machine_listener("127.0.0.1", 0)
print(listener.getsockname()[1], flush=True)
listener.accept()[0].sendall(os.readlink("/proc/self/ns/net").encode())
"""
)
LISTENS = """
from qmn.network.checks import check_address
from qmn.options import BadInput
try:
    check_address(f"127.0.0.1:{sys.stdin.readline().strip()}")
    print("free", flush=True)
except BadInput as error:
    print(error, flush=True)
"""
LOOKS = """
print(os.getpid(), os.listdir("/sys/class/net"), flush=True)
sys.stdin.read()
sys.exit(7)
"""


@contextmanager
def run(folder: Path, script: str) -> Iterator[subprocess.Popen[str]]:
    command = [sys.executable, "-c", script, str(folder)]
    pipe = subprocess.PIPE
    with subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True, cwd=ROOT) as process:
        try:
            yield process
        finally:
            process.kill()


def first_line(process: subprocess.Popen[str]) -> str:
    assert process.stdout is not None
    return process.stdout.readline().strip()


def test_a_run_has_a_network_of_its_own_and_its_status_is_that_of_the_command(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(namespaces, "RUNTIME_ROOT", tmp_path)
    with run(tmp_path, RUN + LOOKS) as process:
        pid, _, interfaces = first_line(process).partition(" ")
        assert int(pid) < 100  # it was the second process or so there
        assert "eth0" not in interfaces
        wait_until(namespaces.running, "the keeper has written its entry")
        (found,) = namespaces.running()
        assert (found.keeper, found.command) == (process.pid, "qmn run")
        assert Path(f"/proc/{found.first}/root/run/qmn/machine-network").exists()
        with socket.create_server(("127.0.0.1", 0)) as ours:
            port = ours.getsockname()[1]
            seen = Path(f"/proc/{found.first}/root/run/qmn/machine-connections").read_text()
            assert f"0100007F:{port:04X}" in users_of(seen)
        process.communicate("", timeout=SOON_S)
        assert process.returncode == 7
    assert namespaces.running() == []
    assert list(tmp_path.iterdir()) == []


def test_a_port_in_use_on_the_machine_is_refused_before_a_network_starts(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as ours:
        port = ours.getsockname()[1]
        with run(tmp_path, RUN + LISTENS) as process:
            reply, _ = process.communicate(str(port), timeout=SOON_S)
    words = f"--rest 127.0.0.1:{port}: cannot listen there: Address already in use"
    assert reply.splitlines()[-1].startswith(words)
    with run(tmp_path, RUN + LISTENS) as process:
        assert process.communicate(str(port), timeout=SOON_S)[0].splitlines()[-1] == "free"


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT])
def test_a_signal_to_the_keeper_reaches_the_run(tmp_path: Path, number: signal.Signals) -> None:
    catches = f"""
import signal
signal.pthread_sigmask(signal.SIG_BLOCK, [{int(number)}])
print("ready", flush=True)
print(signal.sigwait([{int(number)}]), flush=True)
sys.exit(3)
"""
    with run(tmp_path, RUN + catches) as process:
        assert first_line(process) == "ready"
        process.send_signal(number)
        assert first_line(process).endswith(str(int(number)))
        assert process.wait(SOON_S) == 3


def test_a_terminal_interrupts_a_run_once(tmp_path: Path) -> None:
    """It reaches the keeper and the run alike; the keeper must not pass it on."""
    counts = """
import signal
awaited = {signal.SIGINT, signal.SIGTERM}
signal.pthread_sigmask(signal.SIG_BLOCK, awaited)
print("ready", flush=True)
interrupts = 0
while signal.sigwait(awaited) == signal.SIGINT:
    interrupts += 1
    print("interrupted", flush=True)
sys.exit(interrupts)
"""
    keyboard, terminal = pty.openpty()
    command = ["setsid", "--ctty", sys.executable, "-c", RUN + counts, str(tmp_path)]
    with subprocess.Popen(
        command, stdin=terminal, stdout=subprocess.PIPE, text=True, cwd=ROOT
    ) as process:
        os.close(terminal)
        try:
            assert first_line(process) == "ready"
            os.write(keyboard, b"\x03")
            assert first_line(process) == "interrupted"
            process.send_signal(signal.SIGTERM)
            assert process.wait(SOON_S) == 1
        finally:
            process.kill()
            os.close(keyboard)


def test_a_keeper_that_is_killed_takes_everything_with_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(namespaces, "RUNTIME_ROOT", tmp_path)
    daemon = "import subprocess; subprocess.Popen(['sleep', '600'], start_new_session=True)\n"
    with run(tmp_path, RUN + daemon + LOOKS) as process:
        first_line(process)
        (found,) = namespaces.running()
        below = os.pidfd_open(found.first)
        process.kill()
        process.wait(SOON_S)
    assert ends(below)
    assert namespaces.running() == []
    assert list(tmp_path.iterdir()) == []


def ends(process: int) -> bool:
    """Whether a process ends within half a minute; with it all in its namespace have."""
    poll = select.poll()
    poll.register(process, select.POLLIN)
    ended = bool(poll.poll(30_000))
    os.close(process)
    return ended


def test_another_process_goes_on_inside_a_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    enters = RUN.replace(
        'status = namespaces.enter_new(["qmn", "run"])',
        "(found,) = namespaces.running()\nstatus = namespaces.enter(found)",
    )
    with run(tmp_path, RUN + LOOKS) as process:
        first_line(process)
        looks = enters + "print(os.readlink('/proc/self/ns/net'), os.getcwd()); sys.exit(5)"
        done = subprocess.run(
            [sys.executable, "-c", looks, str(tmp_path)],
            capture_output=True,
            text=True,
            check=False,
            timeout=SOON_S,
            cwd=ROOT,
        )
        monkeypatch.setattr(namespaces, "RUNTIME_ROOT", tmp_path)
        (found,) = namespaces.running()
        network = os.readlink(f"/proc/{found.first}/ns/net")
    assert (done.returncode, done.stdout.split()) == (5, [network, str(ROOT)])


def test_a_killed_run_and_a_command_inside_it_end_with_a_reason(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    enters = RUN.replace(
        'status = namespaces.enter_new(["qmn", "run"])',
        "(found,) = namespaces.running()\nstatus = namespaces.enter(found)",
    )
    with run(tmp_path, RUN + LOOKS) as process:
        first_line(process)
        with run(tmp_path, enters + LOOKS) as inside:
            first_line(inside)
            monkeypatch.setattr(namespaces, "RUNTIME_ROOT", tmp_path)
            (found,) = namespaces.running()
            os.kill(found.first, signal.SIGKILL)
            # 128 + 9: what a shell gives for SIGKILL
            assert (process.wait(SOON_S), inside.wait(SOON_S)) == (137, 137)
    assert sorted(capfd.readouterr().err.splitlines()) == [
        f"qmn: run {found} has ended, and this command with it",
        "qmn: the run was killed (SIGKILL); the kernel ended what was left",
    ]


def test_an_entry_that_is_removed_before_it_is_locked_is_written_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(namespaces, "RUNTIME_ROOT", tmp_path)
    file = tmp_path / "1.run"
    with ThreadPoolExecutor(1) as thread, file.open("w") as held:
        fcntl.flock(held, fcntl.LOCK_EX)
        begun = thread.submit(namespaces._begun, file)
        with pytest.raises(TimeoutError):
            begun.result(timeout=0.5)
        file.unlink()
        held.close()
        with begun.result(timeout=SOON_S) as entry:
            assert os.path.samestat(os.fstat(entry.fileno()), file.stat())


def test_who_visits_a_run_outlives_it(tmp_path: Path) -> None:
    visits = RUN.replace(
        'status = namespaces.enter_new(["qmn", "run"])',
        "(found,) = namespaces.running()\nstatus = namespaces.visit(found)",
    )
    looks = """
print(os.readlink("/proc/self/ns/net"), flush=True)
sys.stdin.read()
print(os.listdir("/sys/class/net"), os.path.exists("/run/qmn/machine-network"))
"""
    with run(tmp_path, RUN + LOOKS) as process:
        first_line(process)
        with run(tmp_path, visits + looks) as visitor:
            network = first_line(visitor)
            assert network != os.readlink("/proc/self/ns/net")
            process.communicate("", timeout=SOON_S)
            output, _ = visitor.communicate("", timeout=SOON_S)
            assert (visitor.returncode, output.strip()) == (0, "['lo'] True")


def test_a_run_serves_on_the_loopback_of_the_machine(tmp_path: Path) -> None:
    with run(tmp_path, SERVES) as process:
        port = int(first_line(process))
        with socket.create_connection(("127.0.0.1", port), timeout=SOON_S) as connection:
            network = connection.recv(100).decode()
        assert process.wait(SOON_S) == 0
    assert network != os.readlink("/proc/self/ns/net")
