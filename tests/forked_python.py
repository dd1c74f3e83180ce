"""A Python that has imported the product once: programs that tests start are forked off it.

To start `python -m qmn` takes a third of a second of a processor, nearly all of it for imports.
Forked off, it has them already, and is otherwise the same: a child of the test, with arguments,
environment, folder and files of its own.
"""

import atexit
import functools
import gc
import json
import os
import runpy
import signal
import socket
import subprocess
import sys
from collections.abc import Mapping
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
MODULES = (
    "dispatcher.__main__",
    "evidence.replay.replay",
    "dispatcher.sabot.__main__",
    "hosts.applications.intercept",
    "views.events.event_sources",
    "evidence.replay.verb",
    "views.verbs.runs",
    "applications.circuits.verb",
    "views.verbs.spy",
)
REQUEST_BYTES = 1 << 20
FILES = 3  # standard input, output and error
START_TIMEOUT_S = 60


class Forked(subprocess.Popen[str]):
    """subprocess.Popen of this interpreter with -m or -c; a fork in the place of a start."""

    def _execute_child(self, args: Any, *others: Any) -> None:
        """Have it forked off, as Popen.__init__ asks, with places as in Python 3.11 to 3.13."""
        cwd, env = others[4:6]
        assert args[0] == sys.executable, f"{args[0]} is not this interpreter"
        p2cread, p2cwrite, c2pread, c2pwrite, errread, errwrite = others[9:15]
        request = {
            "words": [os.fspath(word) for word in args[1:]],
            "folder": os.fspath(cwd or os.getcwd()),
            "environment": dict(os.environ if env is None else env),
        }
        ends = zip((p2cread, c2pwrite, errwrite), range(FILES), strict=True)
        self.pid = _server().fork(request, [own if own != -1 else same for own, same in ends])
        self._child_created = True
        self._close_pipe_fds(  # type: ignore[attr-defined]
            p2cread, p2cwrite, c2pread, c2pwrite, errread, errwrite
        )


def run(
    command: list[str],
    timeout: float,
    input: str | None = None,  # noqa: A002 - as subprocess.run has it
    env: Mapping[str, str] | None = None,
    cwd: Path | None = None,
) -> subprocess.CompletedProcess[str]:
    """Run a command to its end, as subprocess.run does; return its status and what it says."""
    pipe = subprocess.PIPE
    given = subprocess.DEVNULL if input is None else pipe
    with Forked(
        command, stdin=given, stdout=pipe, stderr=pipe, text=True, env=env, cwd=cwd
    ) as program:
        try:
            text = program.communicate(input, timeout)
        except BaseException:
            program.kill()
            raise
    return subprocess.CompletedProcess(command, program.returncode, *text)


class _Server:
    """The process that has imported everything."""

    def __init__(self) -> None:
        self._channel, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._channel.settimeout(START_TIMEOUT_S)
        environment = {**os.environ, "PYTHONPATH": str(ROOT), "OPENBLAS_NUM_THREADS": "1"}
        with theirs:
            self._process = subprocess.Popen(
                [sys.executable, __file__, str(theirs.fileno())],
                pass_fds=[theirs.fileno()],
                env=environment,
            )
        atexit.register(self._close)

    def _close(self) -> None:
        self._channel.close()
        self._process.wait(START_TIMEOUT_S)

    def fork(self, request: dict[str, Any], files: list[int]) -> int:
        """Return the process id of a new child of this process."""
        socket.send_fds(self._channel, [json.dumps(request).encode()], files)
        return int(self._channel.recv(64))


@functools.cache
def _server() -> _Server:
    return _Server()


def serve(channel: socket.socket) -> dict[str, Any] | None:
    """Fork for each request; return it in the child, and None when there are no more."""
    from topologies.system.processes.fork_server import fork_sibling  # the path is that of a server

    while True:
        data, files, _flags, _address = socket.recv_fds(channel, REQUEST_BYTES, FILES)
        if not data:
            return None
        child = fork_sibling()
        if not child:
            for place, file in enumerate(files):
                os.dup2(file, place)
            os.closerange(FILES, 1 + max(channel.fileno(), *files))
            request: dict[str, Any] = json.loads(data)
            return request
        for file in files:
            os.close(file)
        channel.send(str(child).encode())


def become(request: dict[str, Any]) -> None:
    """Run what Python would run for these words."""
    signal.signal(signal.SIGINT, signal.default_int_handler)
    os.chdir(request["folder"])
    os.environ.clear()
    os.environ.update(request["environment"])
    option, what, *words = request["words"]
    sys.argv = [option, *words]
    if option == "-m":
        sys.path[0] = request["folder"]
        runpy.run_module(what, run_name="__main__", alter_sys=True)
    else:
        assert option == "-c", option
        sys.path[0] = ""
        sys.modules["__main__"] = ModuleType("__main__")
        exec(compile(what, "<string>", "exec"), sys.modules["__main__"].__dict__)


def main() -> None:
    """Import what programs import, and wait for requests; each child leaves by this function."""
    channel = socket.socket(fileno=int(sys.argv[1]))
    for name in MODULES:
        import_module(name)
    for name in [name for name in sys.modules if name.endswith(".__main__")]:
        del sys.modules[name]
    assert len(os.listdir("/proc/self/task")) == 1, "only a process of one thread can fork"
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # a terminal sends it to all
    gc.collect()
    gc.freeze()
    request = serve(channel)
    channel.detach()
    if request is not None:
        become(request)


if __name__ == "__main__":
    main()
