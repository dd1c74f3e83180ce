"""Programs that are forked off: as those that are started, but for the time that it takes."""

import json
import os
import re
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path

import pytest
from limits import SOON_S, wait_until

from topologies.system.processes import forks
from topologies.system.processes.forks import Forked, ForkServer
from topologies.system.processes.programs import ENVIRONMENT, ROOT, NetworkError, Program, python

# A runner, which starts a dispatcher by a fork server and says both their process ids.
RUNNER = """
import sys
from pathlib import Path
from topologies.system.processes.forks import ForkServer
from topologies.system.processes.programs import Program, python
folder = Path(sys.argv[1])
programs = [Program(name, folder / f"{name}.log") for name in ("fork-server", "dispatcher")]
server, dispatcher = programs
forks = ForkServer(server)
dispatcher.start([python(), "-m", "dispatcher", "--config", sys.argv[2]], forks=forks)
dispatcher.wait_for("ready", 120)
print(server._process.pid, dispatcher._process.pid, flush=True)
sys.stdin.read()
"""
# It has loaded what such a server loads.
LOADED = """
from importlib import import_module
from topologies.system.processes.fork_server import runnable
from topologies.system.processes.forks import MODULES
for module in MODULES:
    import_module(runnable(module))
"""
# A runner whose server cannot become one: the namespaces that it is to enter have gone.
FAILING = """
import os, sys
from topologies.system.processes.forks import ThisProcess
try:
    with open(sys.argv[1], "ab") as log:
        command = [sys.executable, "-m", "topologies.system.processes.fork_server"]
        print(ThisProcess().start("server", command, log.fileno(), int(sys.argv[2]), []).wait(20))
finally:
    print("clean-up of", os.getpid())
"""
# A parent of its own whose child forks siblings: each says who its parent is, and what is random.
SIBLINGS = """
import os, random, secrets, ssl
from cryptography.hazmat.primitives.asymmetric.x25519 import X25519PrivateKey
from topologies.system.processes.fork_server import fork_sibling
def draw():
    key = X25519PrivateKey.generate().private_bytes_raw()
    return random.random(), secrets.token_hex(), ssl.RAND_bytes(16).hex(), key.hex()
draw()
if not os.fork():
    for _ in range(3):
        if not fork_sibling():
            break
    else:
        os._exit(0)
    line = " ".join(map(str, [os.getppid(), *draw()]))
    os.write(1, f"{line}\\n".encode())  # at once: all write into one pipe
    os._exit(0)
for _ in range(4):
    os.wait()
print(os.getpid())
"""


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ForkServer]:
    program = Program("fork-server", tmp_path_factory.mktemp("server") / "fork-server.log")
    server = ForkServer(program)
    yield server
    server.close()
    wait_until(lambda: not program.running, "the server has ended with its socket")


@pytest.fixture
def dispatcher(server: ForkServer, tmp_path: Path) -> Iterator[Program]:
    program = Program("ed", tmp_path / "ed.log")
    program.start(dispatcher_command(tmp_path), forks=server)
    program.wait_for("ready", SOON_S)
    yield program
    program.stop()


def dispatcher_command(folder: Path) -> list[str]:
    config = {"listen": "127.0.0.1:0", "socket": str(folder / "s"), "seed": 1}
    file = folder / "dispatcher.json"
    file.write_text(json.dumps({**config, "tokens": {}, "fibers": [], "switches": []}))
    return [python(), "-m", "dispatcher", "--config", str(file)]


def pid_of(program: Program) -> int:
    assert program._process is not None
    return program._process.pid


def proc(pid: int | str, name: str) -> str:
    return Path("/proc", str(pid), name).read_text()


def test_what_is_forked_is_a_child_of_the_runner_in_a_session_of_its_own(
    dispatcher: Program,
) -> None:
    pid = pid_of(dispatcher)
    assert re.search(r"PPid:\t(\d+)", proc(pid, "status"))[1] == str(os.getpid())  # type: ignore[index]
    assert os.getsid(pid) == pid
    assert os.readlink(f"/proc/{pid}/cwd") == str(ROOT)


def test_siblings_are_their_parents_own_children_and_share_nothing_random() -> None:
    done = subprocess.run(
        [sys.executable, "-c", SIBLINGS],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
        timeout=SOON_S,
    )
    *siblings, parent = done.stdout.splitlines()
    parents, *drawn = zip(*map(str.split, siblings), strict=True)
    assert parents == (parent,) * 3
    assert [len({*each}) for each in drawn] == [3] * 4


def test_it_is_named_and_has_the_environment_of_our_programs(
    dispatcher: Program, tmp_path: Path
) -> None:
    pid = pid_of(dispatcher)
    assert proc(pid, "comm") == "ed\n"
    command = proc(pid, "cmdline").rstrip("\0").split("\0")
    assert command == [python(), "-m", "dispatcher", "--config", f"{tmp_path}/dispatcher.json"]
    environment = proc(pid, "environ").split("\0")
    assert {f"{name}={value}" for name, value in ENVIRONMENT.items()} <= set(environment)


def test_it_has_no_files_but_those_it_was_given(server: ForkServer, tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        program = Program("ed", tmp_path / "ed.log")
        given = [listener.fileno()]
        program.start(dispatcher_command(tmp_path), descriptors=given, forks=server)
        inode = os.fstat(listener.fileno()).st_ino
        folder = Path("/proc", str(pid_of(program)), "fd")
        program.wait_for("ready", SOON_S)
        assert os.readlink(folder / str(listener.fileno())) == f"socket:[{inode}]"
        opened = {}
        for name in os.listdir(folder):
            with suppress(FileNotFoundError):  # closed meanwhile
                opened[name] = os.readlink(folder / name)
    program.stop()
    log = str(tmp_path / "ed.log")
    assert [opened[number] for number in "012"] == ["/dev/null", log, log]
    assert "fork-server" not in " ".join(opened.values())


def test_it_ends_when_told_and_its_status_is_that_of_the_program(dispatcher: Program) -> None:
    dispatcher.stop()
    assert dispatcher.status == 0


def test_one_that_fails_is_named_with_its_fault(server: ForkServer, tmp_path: Path) -> None:
    broken = Program("alice", tmp_path / "alice.log")
    broken.start([python(), "-m", "hosts", "--config", f"{tmp_path}/none"], forks=server)
    with pytest.raises(NetworkError, match=r"alice ended at its start: host stack: .*none"):
        broken.wait_for("ready", SOON_S)
    assert broken.status == 1


def test_one_that_gets_no_namespace_says_why(server: ForkServer, tmp_path: Path) -> None:
    with subprocess.Popen(["true"]) as gone:
        pass
    lost = Program("alice", tmp_path / "alice.log")
    lost.start(dispatcher_command(tmp_path), gone.pid, forks=server)
    wait_until(lambda: not lost.running, "the program has ended")
    assert lost.end() == f"process {gone.pid}, the shell of its node, was ended"


def test_one_that_is_killed_is_said_to_be(dispatcher: Program) -> None:
    os.kill(pid_of(dispatcher), signal.SIGKILL)
    wait_until(lambda: not dispatcher.running, "it has ended")
    assert dispatcher.end() == "killed by SIGKILL"


def test_how_one_ended_is_told_to_all_threads_that_ask() -> None:
    """The kernel tells it once (waitpid(2))."""

    def report(child: Forked) -> int:
        while (status := child.poll()) is None:
            pass
        return status

    with ThreadPoolExecutor(4) as pool:
        for _attempt in range(50):
            pid = os.posix_spawn("/bin/sh", ["sh", "-c", "exit 3"], {})
            assert [*pool.map(report, [Forked(pid)] * 4)] == [3] * 4


@pytest.mark.parametrize(
    ("number", "is_loaded"),
    [(signal.SIGKILL, False), (signal.SIGTERM, False), (signal.SIGKILL, True)],
)
def test_all_end_with_the_runner_however_it_ends(
    tmp_path: Path, number: int, is_loaded: bool
) -> None:
    dispatcher_command(tmp_path)
    program = (LOADED if is_loaded else "") + RUNNER
    command = [sys.executable, "-c", program, str(tmp_path), str(tmp_path / "dispatcher.json")]
    pipe = subprocess.PIPE
    options = {"cwd": ROOT, "env": {**os.environ, **ENVIRONMENT}, "text": True}
    with subprocess.Popen(command, stdin=pipe, stdout=pipe, **options) as runner:  # type: ignore[call-overload]
        pids = runner.stdout.readline().split()
        assert len(pids) == 2
        was_forked = proc(pids[0], "environ") == proc(runner.pid, "environ")
        assert was_forked == is_loaded
        runner.send_signal(number)
        runner.wait(SOON_S)
        for pid in pids:
            wait_until(lambda pid=pid: not Path("/proc", pid).exists(), f"{pid} is gone")  # type: ignore[misc]


def test_what_fails_in_a_server_forked_off_a_runner_does_not_clean_up_there(tmp_path: Path) -> None:
    with subprocess.Popen(["true"]) as gone:
        pass
    log = tmp_path / "log"
    command = [sys.executable, "-c", FAILING, str(log), str(gone.pid)]
    with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True) as runner:
        text, _ = runner.communicate(timeout=SOON_S)
    assert text.splitlines() == ["1", f"clean-up of {runner.pid}"]
    fault = f"fault: process {gone.pid}, the shell of its node, was ended\n"
    assert log.read_text() == fault


def test_a_server_that_was_killed_is_named_and_what_it_has_forked_goes_on(tmp_path: Path) -> None:
    program = Program("fork-server", tmp_path / "fork-server.log")
    server = ForkServer(program)
    forked, late = (Program(name, tmp_path / f"{name}.log") for name in ("ed", "late"))
    command = dispatcher_command(tmp_path)
    forked.start(command, forks=server)
    forked.wait_for("ready", SOON_S)
    os.kill(pid_of(program), signal.SIGKILL)
    with pytest.raises(NetworkError, match="fork-server died in mid-run: killed by SIGKILL"):
        late.start(command, forks=server)
    assert forked.running
    forked.stop()
    server.close()


@pytest.mark.parametrize("waits", [1, 10_000])
def test_a_server_that_is_at_work_is_waited_for_longer(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, waits: int
) -> None:
    """It loads all programs, which takes longer than 30 ms. That it does is not left to chance."""
    monkeypatch.setattr(forks, "FORK_TIMEOUT_S", 0.03)
    monkeypatch.setattr(forks, "FORK_WAITS", waits)
    monkeypatch.setattr(Program, "processor_s", property(lambda _program: time.perf_counter()))
    program, forked = (Program(name, tmp_path / f"{name}.log") for name in ("fork-server", "ed"))
    server = ForkServer(program)
    try:
        if waits == 1:
            with pytest.raises(NetworkError, match=r"fork-server did not start ed in 0\.03 s"):
                forked.start(dispatcher_command(tmp_path), forks=server)
        else:
            forked.start(dispatcher_command(tmp_path), forks=server)
            forked.stop()
    finally:
        server.close()
        program.stop()


def test_a_server_that_a_signal_has_stopped_is_waited_for_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(forks, "FORK_TIMEOUT_S", 0.2)
    program = Program("fork-server", tmp_path / "fork-server.log")
    server = ForkServer(program)
    command = dispatcher_command(tmp_path)
    try:
        program.wait_for("ready", SOON_S)
        os.kill(pid_of(program), signal.SIGSTOP)
        wait_until(lambda: program.stopped, "it is stopped")
        cause = r"fork-server did not start ed in 0.2 s: a signal has stopped it \(SIGSTOP\)"
        with pytest.raises(NetworkError, match=cause):
            Program("ed", tmp_path / "ed.log").start(command, forks=server)
        os.kill(pid_of(program), signal.SIGCONT)  # too late: who has given up does not wait again
        with pytest.raises(NetworkError, match=cause):
            Program("q1", tmp_path / "q1.log").start(command, forks=server)
        assert not (tmp_path / "q1.log").read_text()
    finally:
        server.close()
        program.stop()


def test_the_command_itself_has_the_environment_of_programs() -> None:
    """Else none could be forked off it."""
    output = subprocess.run(
        ["bash", "-c", f"exec() {{ env; }}; source {ROOT}/bin/qmn"],
        env={"PATH": os.environ["PATH"]},
        capture_output=True,
        text=True,
        check=True,
    )
    assert {f"{name}={value}" for name, value in ENVIRONMENT.items()} <= set(
        output.stdout.splitlines()
    )


def test_loggers_of_what_is_loaded_beside_mininet_are_not_mininets() -> None:
    """Mininet's loggers would replace all that are made after it is loaded, and log nothing."""
    loaded = "topologies.system.processes.forks, mininet.net, logging"
    script = f"import {loaded}; print(type(logging.getLogger('ours')))"
    done = subprocess.run([sys.executable, "-c", script], cwd=ROOT, capture_output=True, check=True)
    assert done.stdout == b"<class 'logging.Logger'>\n"


def test_a_host_loads_no_registered_message_after_the_fork() -> None:
    """Each would have memory of its own for that."""
    code = "import sys\nbefore = set(sys.modules)\nfrom wire.device import kinds\nassert kinds()\n"
    script = f"{LOADED}{code}print(sorted(sys.modules.keys() - before))"
    done = subprocess.run([python(), "-c", script], capture_output=True, text=True, cwd=ROOT)
    assert (done.stdout, done.stderr) == ("[]\n", "")
