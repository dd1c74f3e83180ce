"""A node of a network on another machine than the runner's: a mixin of node classes."""

import os
import shlex
import signal
import socket
import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from topologies.system.confinement.confinement import APART, GIVEN_UP, closing, fstab
from topologies.system.kernel.memory_share import KIB, MIB
from topologies.system.machines.machine import NOWHERE, Machine, ProcessElsewhere
from topologies.system.processes.programs import NetworkError
from topologies.timeouts import COMMAND_TIMEOUT_S, END_TIMEOUT_S


class NodeElsewhere:
    machine: Machine
    name: str
    pid_there = NOWHERE

    def startShell(self, mnopts: str | None = None) -> None:  # noqa: N802 (Mininet's name)
        node: Any = self
        del mnopts
        ours, self._terminal = socket.socketpair()
        shell = self.machine.start_shell(self.name, self._terminal_says, node.confined)
        self.pid_there = shell.pid_there
        self.machine.connect(self._terminal, shell)
        node.pid, node.slave = NOWHERE, os.open(os.devnull, os.O_RDWR)  # Mininet closes it
        node.attach(shell, ours.detach())
        node.without_ipv6()
        variables = self.environment()
        node.cmd("export " + " ".join(f'{name}="{value}"' for name, value in variables.items()))

    def _terminal_says(self, data: bytes) -> None:
        self._terminal.setblocking(True)
        self._terminal.sendall(data)
        self._terminal.setblocking(False)

    @property
    def shell_stopped(self) -> bool:
        """Say no: the agent there sees to that."""
        return False

    def _kill_shell(self) -> None:
        shell: ProcessElsewhere = self.shell  # type: ignore[attr-defined]
        shell.kill()
        if not self.machine.lost:
            shell.wait(END_TIMEOUT_S)

    def hang_up(self) -> None:
        shell: ProcessElsewhere | None = getattr(self, "shell", None)
        if shell is not None:
            shell.send_signal(signal.SIGHUP)

    def kill_group(self) -> None:
        """Leave that to the agent there."""

    def terminate(self) -> None:
        super().terminate()  # type: ignore[misc]
        self.machine.disconnect(self._terminal)

    def confine(
        self, shown: Mapping[Path, str], covered: Sequence[Path], table: Path, memory_mib: int
    ) -> None:
        """Confine the shell as on this machine; of what is covered here only /run has a part there.

        It is the agent's own. Each process may take so much memory, all together any.
        """
        there = [folder for folder in covered if folder.is_relative_to("/run")]
        for folder in (*shown, *there):
            self.machine.ask("folder", path=str(folder))
        shell = f"{self.machine.root}/topologies/system/confinement/confined_shell"
        ruled = [Path(path) for path in self.machine.ask("ruled")]
        self.machine.put(table, fstab(shown, there, ruled).encode())
        node: Any = self
        user = node.shell.user
        command = [*APART, shell, self.name, memory_mib * MIB // KIB]
        command += [GIVEN_UP if user is None else user, table, *shown, "--", *there]
        node.write(f"exec {shlex.join(map(str, command))}\n")
        node.await_shell(closing(user))

    def environment(self) -> dict[str, str]:
        root, python = self.machine.root, os.path.dirname(self.machine.python)
        variables: dict[str, str] = super().environment()  # type: ignore[misc]
        return {**variables, "PYTHONPATH": str(root), "PATH": f"{root}/bin:{python}:$PATH"}

    def pexec(self, *words: Any, **_options: Any) -> tuple[str, str, int]:
        """Run a command there; return what it says, "" for its errors, which are with that."""
        (first, *others) = words
        command = [*first] if isinstance(first, list | tuple) else [*first.split(), *others]
        output = bytearray()
        process = self.machine.start(command, output.extend, self.pid_there)
        try:
            status = process.wait(COMMAND_TIMEOUT_S)
        except subprocess.TimeoutExpired as error:
            process.kill()
            text = f"{self.name}: {shlex.join(command)} took over {COMMAND_TIMEOUT_S:g} s"
            raise NetworkError(f"{text} on {self.machine.name}") from error
        return output.decode(errors="replace"), "", status

    def popen(self, *arguments: Any, **_options: Any) -> Any:
        """Raise NetworkError: a process of another machine is no Popen of this one."""
        command = arguments[0] if isinstance(arguments[0], str) else shlex.join(arguments[0])
        raise NetworkError(
            f"{self.name} is on {self.machine.name}, where {command} cannot be started so: "
            "use `cmd` of the host, `run_on` of the network, or place it on the first machine"
        )


def elsewhere(kind: type, machine: Machine) -> type:
    return type(f"{kind.__name__}On{machine.name}", (NodeElsewhere, kind), {"machine": machine})
