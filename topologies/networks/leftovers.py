"""The leftovers of killed runs on this machine, and their removal."""

from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

from topologies.networks.network import bridges_of_gone, interfaces_of, sweep, switches_of
from topologies.system.kernel.memory_share import groups_of_gone
from topologies.system.open_vswitch import openvswitch
from topologies.system.processes import owners
from topologies.system.processes.owners import Owner, this_process
from topologies.system.runs.runtime import RUNTIME_ROOT, folders_of_gone, only_run


@dataclass(frozen=True)
class Leftovers:
    """Things of runs whose process is gone."""

    folders: tuple[str, ...] = ()  # private ones, with sockets and tokens
    processes: tuple[str, ...] = ()  # by id and program
    bridges: tuple[str, ...] = ()
    interfaces: tuple[str, ...] = ()
    groups: tuple[str, ...] = ()  # of processes that shared memory
    open_vswitch: tuple[str, ...] = ()  # its starter, if it was started by such a run

    def lines(self) -> list[str]:
        """Return each thing in words."""
        return [
            *(f"folder {name}" for name in self.folders),
            *(f"process {name}" for name in self.processes),
            *(f"bridge {name}" for name in self.bridges),
            *(f"interface {name}" for name in self.interfaces),
            *(f"group {name}" for name in self.groups),
            *(f"Open vSwitch, started by run {name}" for name in self.open_vswitch),
        ]


def find(root: Path = RUNTIME_ROOT) -> Leftovers:
    """Return what is left; raise NetworkError if Open vSwitch does not say."""
    folders = folders_of_gone(root)
    bridges: list[str] = []
    others: set[str] = set()
    if openvswitch.installed() and openvswitch.running():
        bridges = bridges_of_gone()
        others = set(openvswitch.bridges()) - set(bridges)
    named = {name for folder in folders for name in switches_of(folder)}
    return Leftovers(
        tuple(map(str, folders)),
        tuple(_named(process) for process, run in owners.marked() if owners.gone(run)),
        tuple(bridges),
        tuple(found for name in sorted(named - others) for found in interfaces_of(name)),
        tuple(map(str, groups_of_gone())),
        tuple(name for name in [openvswitch.starter()] if owners.gone(name)),
    )


def _named(process: Owner) -> str:
    """Return id and program of a process."""
    try:
        program = Path("/proc", str(process.pid), "comm").read_text().strip()
    except OSError:
        program = "that has ended"
    return f"{process.pid} ({program})"


def remove() -> Leftovers:
    """Remove what is left and return what that was; raise NetworkError while a network runs."""
    with ExitStack() as stack:
        stack.enter_context(only_run())
        found = find()
        if not found.lines():
            return found
        owner = str(this_process())
        stack.callback(openvswitch.stop_if_ours, owner)
        if openvswitch.running():
            openvswitch.adopt(owner)
        else:
            openvswitch.start(owner)  # it alone knows of bridges that it has when it starts
        sweep()
    return found
