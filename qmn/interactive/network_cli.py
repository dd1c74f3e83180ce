"""Mininet's command line over our network: for people, and for scripts whose failures count."""

import logging
import math
import os
import select
import subprocess
import sys
import time
from collections.abc import Collection, Iterable, Sequence
from pathlib import Path
from typing import Any

from mininet.cli import CLI
from mininet.log import lg, output
from mininet.util import quietRun

from qmn.jobs.transfer import TransferError
from qmn.network.custom_topology import BadTopology
from qmn.options import BadInput
from qmn.running.controller_console import NoAnswer
from qmn.scripting.network import QuantumNetwork
from qmn.timeouts import BACKGROUND_TIMEOUT_S, SWITCHES_TIMEOUT_S
from topologies.networks.discovery import heard_again
from topologies.networks.network import Interrupted
from topologies.system.processes.programs import ROOT, NetworkError, callers_environment
from topologies.timeouts import SHELL_POLL_MS
from wire.parameters.checks import NEAR, remedy

STATUS = "QMN_STATUS"  # variable in a host's shell: how the last command of a script ended
FAULTS = (BadInput, BadTopology, NetworkError, NoAnswer, TransferError)


class MininetErrors(logging.StreamHandler[Any]):
    """Shows what Mininet calls an error, and counts these."""

    terminator = ""

    def __init__(self) -> None:
        super().__init__(sys.stderr)
        self.setLevel(logging.ERROR)
        self.count = 0

    def emit(self, record: logging.LogRecord) -> None:
        self.count += 1
        super().emit(record)


class NetworkCLI(CLI):
    """Runs until exit; `script` holds lines to be done instead of asking for them.

    `failures` says how many commands have failed. KeyboardInterrupt ends a script, but at the
    prompt only the verb.
    """

    prompt = "qmn> "
    identchars = CLI.identchars + "-."  # of the first word of a line
    helpStr = CLI.helpStr.replace(CLI.prompt, prompt)  # noqa: N815 (Mininet's name)

    host_verbs: Sequence[str] = ()  # of a subclass, which may follow the name of a host

    def __init__(self, network: QuantumNetwork, script: Iterable[str] | None = None) -> None:
        self.network = network
        self.failures = 0
        self._script = script
        self._reported: set[str] = set()
        self._errors = MininetErrors()
        lg.addHandler(self._errors)
        normal = lg.ch.stream
        lg.ch.setStream(sys.stdout)
        only_output = _below_error
        lg.ch.addFilter(only_output)
        try:
            if script is None:
                super().__init__(network.net)
            else:
                # Mininet passes on to a host's command what it can read: here it can read nothing.
                nothing, writer = os.pipe()
                with os.fdopen(nothing) as silent, os.fdopen(writer, "w"):
                    super().__init__(network.net, stdin=silent)
        finally:
            lg.ch.removeFilter(only_output)
            lg.ch.setStream(normal)
            lg.removeHandler(self._errors)

    def run(self) -> None:
        if self._script is None:
            super().run()
            return
        for line in self._script:
            if self.postcmd(self.onecmd(line.strip()), line):
                return

    def onecmd(self, line: str) -> bool:
        """Do one command; what is wrong becomes one line."""
        if line.lstrip().startswith("#"):
            return False
        before = self._errors.count
        sys.stdout.flush()  # so that what `sh` prints comes behind it
        try:
            host, *command = line.split(None, 1)[:2] or [""]
            if command and host in self.mn:  # though there is a verb of this name
                self.default(line)
                stop = False
            else:
                stop = super().onecmd(line)
        except Interrupted:
            raise
        except FAULTS as error:
            self._reported.add(str(error))
            self._fail(str(error))
            return False
        except Exception as error:  # noqa: BLE001 - whatever a verb of Mininet raises
            text = " ".join(str(error).split())
            self._fail(f"{line.strip()}: {type(error).__name__}{text and f': {text}'}")
            return False
        self.failures += self._errors.count > before
        return bool(stop)

    def postcmd(self, stop: bool, line: str) -> bool:
        """Say once what has died in the network; raise Interrupted if a signal has come."""
        try:
            self.network.check()
        except NetworkError as error:
            if str(error) not in self._reported:
                self._reported.add(str(error))
                self._fail(str(error))
        return stop

    def _fail(self, text: str) -> None:
        self.failures += 1
        print(f"*** {text}", file=sys.stderr, flush=True)

    def default(self, line: str) -> None:
        host, verb, rest = [*line.split(None, 2), "", ""][:3]
        if host in self.mn and verb in self.host_verbs:
            self.onecmd(f"{verb} {host} {rest}")
        elif host in self.mn and verb and self._script is not None and not line.endswith("&"):
            super().default(f"{line} ; {STATUS}=$?")  # Mininet puts addresses for whole words
            status = self.mn[host].cmd(f'echo "${STATUS}"').strip()
            if status != "0":
                self._fail(f"{line}: status {status}{_meant(verb, self.host_verbs)}")
        else:
            commands = {name[3:] for name in self.get_names() if name.startswith("do_")} | set(
                self.mn
            )
            super().default(line + ("" if host in self.mn else _meant(host, commands)))

    def waitForNode(self, node: Any) -> None:  # noqa: N802 (Mininet's name)
        """Pass keys on, and show output, until the command has ended; or its shell: NetworkError.

        Mininet would wait for the output of a shell that has ended, for ever.
        """
        if self.isatty():
            quietRun("stty -icanon min 1")  # so that programs get each key
        typed, shown = self.stdin.fileno(), node.stdout.fileno()
        poller = select.poll()
        for file in (typed, shown):
            poller.register(file, select.POLLIN)
        waits = node.lastCmd.split()[:1] == ["wait"]  # for programs in the background
        deadline = time.monotonic() + (BACKGROUND_TIMEOUT_S if waits else math.inf)
        while node.waiting:
            try:
                if time.monotonic() > deadline:
                    deadline = math.inf
                    print(f"*** {node.name}: {BACKGROUND_TIMEOUT_S:g} s are over", file=sys.stderr)
                    node.sendInt()
                ready = {
                    file for file, event in poller.poll(SHELL_POLL_MS) if event & select.POLLIN
                }
                if typed in ready:
                    node.write(self.stdin.read(1))
                if shown in ready:
                    output(node.monitor())
                elif node.shell_ended:
                    node.waiting = False
                    raise NetworkError(node.no_shell)
            except KeyboardInterrupt:
                node.sendInt()

    def do_source(self, line: str) -> None:
        """Do the commands of a file.
        Usage: source FILE"""
        (path,) = arguments_of(line, "source FILE", 1)
        try:
            lines = Path(path).read_text(errors="replace").splitlines()
        except OSError as error:
            raise BadInput(f"source {path}: {error.strerror}") from error
        for each in lines:
            self.onecmd(each)

    def do_switch(self, line: str) -> None:
        """Stop a switch, or start it: then the controller has heard of it.
        Usage: switch NAME start|stop"""
        name, act = arguments_of(line, "switch NAME start|stop", 2)
        switches = {switch.name: switch for switch in self.mn.switches}
        if name not in switches or act not in ("start", "stop"):
            choices = switches if name not in switches else ("start", "stop")
            wrong = name if name not in switches else act
            raise BadInput(f"switch: {wrong!r}: {remedy(wrong, sorted(choices))}")
        with heard_again(self.network.runtime, switches[name], act == "start"):
            super().do_switch(line)

    def do_wait(self, line: str) -> None:
        """Wait until the switches have connected to the controller.
        Usage: wait"""
        arguments_of(line, "wait", 0)
        if not self.mn.waitConnected(timeout=SWITCHES_TIMEOUT_S):
            raise NetworkError(f"not all switches have connected in {SWITCHES_TIMEOUT_S:g} s")

    def do_sh(self, line: str) -> None:
        """Run a command of this machine's shell, which finds `qmn`.
        Usage: sh COMMAND"""
        path = f"{ROOT / 'bin'}{os.pathsep}{os.environ.get('PATH', os.defpath)}"
        subprocess.run(line, shell=True, check=False, env={**callers_environment(), "PATH": path})  # noqa: S602

    def getLocals(self) -> dict[str, Any]:  # noqa: N802 (Mininet's name)
        """Return what `py` sees: `network` as scripts have it, `net`, and every node."""
        seen: dict[str, Any] = super().getLocals()  # which keeps what `px` has named
        seen["network"] = self.network
        return seen

    def completenames(self, text: str, *_where: object) -> list[str]:
        return sorted({*super().completenames(text), *self._beginning(text, self.mn)})

    def completedefault(self, text: str, line: str, begin: int, _end: int) -> list[str]:
        """Return nodes, behind a host also quantum verbs, behind `link` its states."""
        before = line[:begin].split()
        choices = list(self.mn)
        if len(before) == 1 and before[0] in self.mn:
            choices += self.host_verbs
        if before[:1] == ["link"] and len(before) == 3:
            choices = ["up", "down"]
        return self._beginning(text, choices)

    @staticmethod
    def _beginning(text: str, words: Iterable[str]) -> list[str]:
        return sorted(word for word in words if word.startswith(text))


def _below_error(record: logging.LogRecord) -> bool:
    return record.levelno < logging.ERROR


def _meant(word: str, names: Collection[str]) -> str:
    """Return what may be meant by a word, as the end of an error; nothing if it is known."""
    near = remedy(word, names)
    return f": {near}" if word not in names and near.startswith(NEAR) else ""


def arguments_of(line: str, usage: str, count: int, *default: str) -> list[str]:
    """Return `count` arguments, the last one perhaps the default; raise BadInput otherwise."""
    arguments = line.split()
    if len(arguments) == count - 1:
        arguments += default
    if len(arguments) != count:
        raise BadInput(f"usage: {usage}")
    return arguments
