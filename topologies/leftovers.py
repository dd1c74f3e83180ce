"""The leftovers of killed runs on this machine, and their removal."""

import os
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

from topologies import openvswitch
from topologies.network import SWITCHES, interfaces_of, sweep
from topologies.runtime import RUNTIME_ROOT, alive, only_run


@dataclass(frozen=True)
class Leftovers:
    """Things of runs whose process is gone."""

    folders: tuple[str, ...] = ()  # private ones, with sockets and tokens
    bridges: tuple[str, ...] = ()
    interfaces: tuple[str, ...] = ()
    open_vswitch: tuple[str, ...] = ()  # its starter, if it was started by such a run

    def lines(self) -> list[str]:
        """Return each thing in words."""
        return [
            *(f"folder {name}" for name in self.folders),
            *(f"bridge {name}" for name in self.bridges),
            *(f"interface {name}" for name in self.interfaces),
            *(f"Open vSwitch, started by run {name}" for name in self.open_vswitch),
        ]


def find(root: Path = RUNTIME_ROOT) -> Leftovers:
    """Return what is left; raise NetworkError if Open vSwitch does not say."""
    folders = [path for path in root.glob("*") if path.name.isdigit() and not alive(path.name)]
    bridges: list[str] = []
    starter: list[str] = []
    if openvswitch.installed() and openvswitch.running():
        owners = {name: openvswitch.owner_of(name) for name in openvswitch.bridges()}
        bridges = [name for name, owner in owners.items() if _gone(owner)]
        others = set(owners) - set(bridges)
        starter = [name for name in [openvswitch.starter()] if _gone(name)]
    else:
        others = set()
    files = [folder / SWITCHES for folder in folders]
    named = {name for file in files if file.exists() for name in file.read_text().split()}
    interfaces = [found for name in sorted(named - others) for found in interfaces_of(name)]
    return Leftovers(
        tuple(str(folder) for folder in sorted(folders)),
        tuple(sorted(bridges)),
        tuple(interfaces),
        tuple(starter),
    )


def remove() -> Leftovers:
    """Remove what is left and return what that was; raise NetworkError while a network runs."""
    with ExitStack() as stack:
        stack.enter_context(only_run())
        found = find()
        if not found.lines():
            return found
        owner = str(os.getpid())
        stack.callback(openvswitch.stop_if_ours, owner)
        if openvswitch.running():
            openvswitch.adopt(owner)
        else:
            openvswitch.start(owner)  # it alone knows of bridges that it has when it starts
        sweep()
    return found


def _gone(owner: str) -> bool:
    return owner.isdigit() and not alive(owner)
