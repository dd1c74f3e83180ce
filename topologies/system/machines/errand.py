"""A program on another machine, whose words name files of this one."""

from collections.abc import Sequence
from pathlib import Path

from topologies.system.machines.machine import Machine
from topologies.system.processes.programs import Program, python


class Errand:
    """A command, and the files that go there with it and come back."""

    def __init__(self, machine: Machine, folder: Path, command: Sequence[str]) -> None:
        self._machine, self._back = machine, dict[Path, Path]()
        self._ours = [*command[:1]] == [python()]
        rest = command[1:] if self._ours else command
        self._command = [self._there(word, folder) for word in rest]

    def _there(self, word: str, folder: Path) -> str:
        """Return a word as it reads there; a file that is here already goes along."""
        path = Path(word)
        if not path.is_absolute() or path.is_relative_to(folder.parent):
            return word  # the folder of the run has the same path there
        if path.is_file():
            self._machine.put(folder / path.name, path.read_bytes())
        elif path.parent.is_dir() and not path.exists():
            self._machine.ask("folder", path=str(folder))
            self._back[path] = folder / path.name
        else:
            return word
        return str(folder / path.name)

    def start(self, program: Program, pid: int) -> None:
        program.start_elsewhere(self._machine, self._command, pid, self._ours)

    def bring_back(self) -> None:
        """Write here what it has written there, unless the machine is lost."""
        for here, there in self._back.items():
            if not self._machine.lost and (data := self._machine.get(there)) is not None:
                here.touch(mode=0o600)
                here.write_bytes(data)
