"""Programs that some processes have loaded for all networks of these tests, and fork off.

Else each run would spend most of its processor time on loading them again. Tests of
strikes and signals start `qmn` itself, as a user does, and so do the examples and the pages.
"""

import os
import signal
import subprocess
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, nullcontext
from pathlib import Path
from tempfile import TemporaryFile
from threading import Lock, Thread
from typing import IO, Any

from limits import PROGRAM_S, WAIT_S

from topologies.system.processes.forks import MODULES, Forked, ForkServer, request
from topologies.system.processes.programs import ENVIRONMENT, ROOT, Program, python

QMN, CONTROLLER = "whole_qmn", "whole_controller"  # modules beside this one
ON_FRAMEWORK = "framework_server"  # and one that loads the controller beside all else
FOLDER = Path(__file__).parent
END_TIMEOUT_S = READY_TIMEOUT_S = WAIT_S  # when a test is over, nothing else ends it


class LastingProgram(Program):
    """A program of no network: it has not the mark by which one ends what is left of it."""

    def start(self, command: Sequence[str], *_: object, **options: Any) -> None:
        """Start it with the files that it is to have; it ends when the other end of one closes."""
        paths = {"PYTHONPATH": f"{ROOT}:{FOLDER}"}
        with self.log.open("ab") as log:
            self._process = subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                cwd=ROOT,
                env={**os.environ, **ENVIRONMENT, **paths},
                start_new_session=True,
                pass_fds=options["descriptors"],
            )


class FurtherProgram(Program):
    """A fork server that another forks off, to load the controller on a framework, too."""

    def __init__(self, log: Path, framework: str, base: ForkServer) -> None:
        super().__init__("fork-server", log)
        self._framework, self._base = framework, base

    def start(self, command: Sequence[str], *_: object, **options: Any) -> None:
        """Start it with the files that it is to have."""
        words = [*command[:2], ON_FRAMEWORK, self._framework, *command[3:]]
        descriptors = options["descriptors"]
        with self.log.open("ab") as log:
            asked = request(self.name, words, None, descriptors)
            self._process = self._base.fork(asked, [log.fileno(), *descriptors])


class LastingForkServer(ForkServer):
    """A fork server of all networks."""

    def __init__(self, program: Program, modules: Sequence[str]) -> None:
        self.program = program
        super().__init__(program, modules)
        program.wait_for("ready", READY_TIMEOUT_S)

    def end(self) -> None:
        """End it."""
        self.close()
        assert self.program._process is not None
        self.program._process.wait(END_TIMEOUT_S)


class Loaded(ForkServer):
    """The fork servers of these tests, as one.

    One has loaded all but the controller; the others are forks of it when they are needed first,
    and have loaded that, too. All they fork off ends with the thread that makes this.
    """

    def __init__(self, folder: Path) -> None:
        self._folder, self._starting = folder, Lock()
        program = LastingProgram("fork-server", folder / "fork-server.log")
        self._base = LastingForkServer(program, [*MODULES, QMN, ON_FRAMEWORK])
        self._on: dict[str, LastingForkServer] = {}  # by framework

    @property
    def pids(self) -> set[int]:
        """The process ids of the servers."""
        return {server.program.pid for server in self._servers()}

    def _servers(self) -> list[LastingForkServer]:
        return [*self._on.values(), self._base]

    def close(self) -> None:
        """Stay, for the next network."""

    def end(self) -> None:
        """End the servers."""
        for server in self._servers():
            server.end()

    def serves(self, command: Sequence[str]) -> bool:
        """Whether a command starts what is loaded, or will be."""
        is_python = [*command[:2]] == [python(), "-m"]
        return is_python and command[2] in (*MODULES, "controller_apps")

    def start(
        self,
        name: str,
        command: Sequence[str],
        log: int,
        namespace_pid: int | None,
        descriptors: Sequence[int],
    ) -> Forked:
        """Start it, as Program.start says."""
        asked = request(name, command, namespace_pid, descriptors)
        return self._fork(command, asked, [log, *descriptors])

    def _fork(self, command: Sequence[str], asked: dict[str, Any], files: list[int]) -> Forked:
        """Fork off what has loaded a command; with `qmn`, the controller that it will start."""
        module = {"qmn": QMN, "controller_apps": CONTROLLER}.get(command[2])
        if module is None:
            return self._base.fork(asked, files)
        return self._on_framework(command).fork(asked | {"module": module}, files)

    def run(
        self, words: tuple[str, ...], cwd: Path, commands: str, timeout_s: float
    ) -> subprocess.CompletedProcess[str]:
        """Run `qmn` as subprocess.run would, which raises subprocess.TimeoutExpired."""
        command = [python(), "-m", "qmn", *words]
        with TemporaryFile("w+") as given, TemporaryFile("w+") as out, TemporaryFile("w+") as err:
            given.write(commands)
            given.seek(0)
            asked = request("qmn", command, None, [0, 2]) | {"folder": str(cwd)}
            files = [file.fileno() for file in (out, given, err)]
            process = self._fork(command, asked, files)
            try:
                status = process.wait(timeout_s)
            except BaseException:
                process.send_signal(signal.SIGTERM)  # it cleans up, for the tests behind this one
                process.wait(END_TIMEOUT_S)
                raise
            finally:
                process.kill()
            return subprocess.CompletedProcess(command, status, read(out), read(err))

    def begin(
        self, name: str, command: Sequence[str], errors: IO[str] | None = None, typed: bool = False
    ) -> "Running":
        """Begin to run a command; what it says as errors goes to a file, if one is given.

        If it is `typed` to, it reads what is written to `stdin`.
        """
        with ExitStack() as stack:
            ours, text = os.pipe()
            files = {1: text}
            stack.callback(os.close, text)
            stdin = None
            if typed:
                files[0], keyboard = os.pipe()
                stack.callback(os.close, files[0])
                stdin = os.fdopen(keyboard, "w", buffering=1)
            if errors is not None:
                files[2] = errors.fileno()
            descriptors = [number for number in files if number != 1]
            asked = request(name, command, None, descriptors)
            process = self._fork(command, asked, [*files.values()])
            return Running(process, os.fdopen(ours), stdin)

    def _on_framework(self, command: Sequence[str]) -> LastingForkServer:
        """Return what has loaded the framework that a command names, or else takes."""
        name = "os-ken" if "os-ken" in command else "ryu"
        with self._starting:  # nodes start at the same time
            if name not in self._on:
                program = FurtherProgram(self._folder / f"{name}.log", name, self._base)
                self._on[name] = LastingForkServer(program, [*MODULES, QMN, CONTROLLER])
            return self._on[name]


class Running:
    """A program that runs, as subprocess.Popen has it, and what it says."""

    def __init__(self, process: Forked, stdout: IO[str], stdin: IO[str] | None) -> None:
        self.stdout, self.stdin, self.pid = stdout, stdin, process.pid
        self.send_signal, self.kill = process.send_signal, process.kill
        self.poll, self.wait = process.poll, process.wait

    @property
    def returncode(self) -> int | None:
        """The exit status, None while it runs."""
        return self.poll()

    def finish(self, timeout_s: float) -> str:
        """Wait until it has ended; return its output since the last read."""
        lines: list[str] = []
        # Nobody ends who cannot say all that he has to.
        reader = Thread(target=lambda: lines.append(self.stdout.read()))
        reader.start()
        self.wait(timeout_s)
        reader.join(timeout_s)
        return lines[0]


def read(file: IO[str]) -> str:
    """Return all that is in a file."""
    file.seek(0)
    return file.read()


_loaded: Loaded | None = None


@contextmanager
def serving(folder: Path) -> Iterator[None]:
    """Let programs be forked off; end all that has loaded them."""
    global _loaded
    _loaded = Loaded(folder)
    try:
        yield
    finally:
        _loaded.end()
        _loaded = None


def forks() -> Loaded:
    """Return who forks programs off in these tests."""
    assert _loaded is not None, "the fixture that starts it comes first"
    return _loaded


@contextmanager
def running_qmn(
    *words: str, errors: IO[str] | None = None, typed: bool = False, end_s: float = END_TIMEOUT_S
) -> Iterator[Running]:
    """Run `qmn` beside the test, as `begin` says, to its end."""
    process = forks().begin("qmn", [python(), "-m", "qmn", *words], errors, typed)
    with process.stdout, process.stdin or nullcontext():
        try:
            yield process
        except BaseException:
            process.send_signal(signal.SIGTERM)  # it cleans up, for the tests behind this one
            raise
        finally:
            try:
                process.finish(end_s)
            finally:
                process.kill()


def run_qmn(
    *words: str, cwd: Path = ROOT, commands: str = "", timeout_s: float = PROGRAM_S
) -> subprocess.CompletedProcess[str]:
    """Run `qmn` to its end, with such lines to read; return what it printed, and its status."""
    return forks().run(words, cwd, commands, timeout_s)
