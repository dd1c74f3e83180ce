"""A host with copper alone."""

import os
import re
import subprocess
from pathlib import Path

from mininet.log import warn
from mininet.node import Host

from topologies.links.keywords import refuse_unknown
from topologies.nodes.node import QuantumNode
from topologies.system.confinement.confinement import ConfinedNode
from topologies.system.kernel.interfaces import (
    HOST_WINDOW,
    PATIENT,
    finish_checksums,
    repeat_nothing,
    set_mtu,
    within,
)
from topologies.system.kernel.memory_share import checked_mib
from topologies.system.kernel.user_namespace import NoUserNamespace, without_user_namespaces
from topologies.system.open_vswitch import openvswitch
from topologies.system.processes.programs import NetworkError, Program
from topologies.system.runs import runtime
from topologies.system.runs.runtime import Runtime
from wire.network_time import SteppedTime

DEFAULT_PREFIX_LENGTH = 8  # Mininet's
REPEATS = "rto_min 200ms quickack 1"  # what a switch has lost, as by default
# The entries of a folder of runs.
OF_RUNS = re.compile(r"\d{8}T\d{6}-.+|\.?latest.*|\.index\.sqlite.*|\.cache")


def covered_folders(network: Runtime) -> list[Path]:
    """Return the folders with what hosts are not to see of a run, or of others on this machine."""
    further = network.settings.keys, os.environ.get(runtime.LIVE_PAGES)  # one acts by a page
    others = [Path(folder) for folder in further if folder]
    logs = folder_of_runs(network.logs.resolve())
    return [runtime.RUNTIME_ROOT, openvswitch.RUN_FOLDER, logs, *others]


def folder_of_runs(logs: Path) -> Path:
    """Return the folder that has this run and others, or the run's own if there is more in there.

    People may want to read files beside their runs on a host.
    """
    runs = logs.parent
    alone = all(OF_RUNS.fullmatch(name) for name in os.listdir(runs))
    return runs if alone and not Path.cwd().is_relative_to(runs) else logs


class ClassicalHost(QuantumNode, ConfinedNode, Host):
    """A host whose interfaces suit a switch in user space: no IPv6, finished checksums.

    Programs that people start on it see their own processes, and of the run their own folder; with
    `confined=False` it sees all, and can mount, as on a host of Mininet's. It may take `memory_mib`
    of this machine's memory, half of that if nobody says; unless it is not confined.
    """

    def __init__(
        self, name: str, confined: bool = True, memory_mib: int | None = None, **params: object
    ) -> None:
        refuse_unknown(name, params, type(self))
        self.network = runtime.current()
        self.confined, self.memory_mib = confined, checked_mib(name, memory_mib)
        self.program: Program | None = None
        super().__init__(name, **params)
        self.network.hosts.append(self)
        self.network.addresses[name], _, bits = str(params["ip"]).partition("/")
        self.network.prefix_length = int(bits or DEFAULT_PREFIX_LENGTH)

    def _begin_shell(self) -> "subprocess.Popen[bytes]":
        network = self.network
        if self.confined and self.inNamespace and network.user_namespaces:
            try:
                return self.begin_in_user_namespace()
            except NoUserNamespace as error:
                network.user_namespaces = False
                warn(without_user_namespaces(f"hosts, from {self.name} on,", str(error)))
        return super()._begin_shell()

    def config(self, **params: object) -> dict[str, object]:
        result: dict[str, object] = super().config(**params)
        if openvswitch.datapath() == "user":
            within(self, finish_checksums, str(self.defaultIntf()))
        if isinstance(self.network.time, SteppedTime):
            self._wait_for_stepped_time()
        if self.network.mtu:
            within(self, set_mtu, str(self.defaultIntf()), self.network.mtu)
        if self.confined:
            table = self.network.folder / f"{self.name}.fstab"
            covered = covered_folders(self.network)
            self.confine(self.shown_folders(), covered, table, self.memory_mib)
        return result

    def _wait_for_stepped_time(self) -> None:
        """Have TCP wait for answers while time stands: it would repeat what is on its way.

        And answer at once: what waits for an acknowledgement cannot be seen, and time would leap.
        No cable holds back what goes to and from the dispatcher; time stands until it has come.
        """
        within(self, repeat_nothing, HOST_WINDOW)
        dispatcher, _, _port = self.network.dispatcher.partition(":")
        route = self.cmd(f"ip -color=never route show dev {self.defaultIntf()}").strip()
        is_there = self.IP() == dispatcher
        self._route("change", route, REPEATS if is_there else PATIENT)
        if dispatcher and not is_there:
            self._route("add", f"{dispatcher} scope link", REPEATS)

    def _route(self, change: str, route: str, patience: str) -> None:
        to = f"{route} dev {self.defaultIntf()} {patience}"
        if refusal := self.cmd(f"ip route {change} {to}"):
            raise NetworkError(f"{self.name}: ip route {change} {to}: {refusal.strip()}")

    def shown_folders(self) -> dict[Path, str]:
        return {}

    def terminate(self) -> None:
        if self.program:
            self.program.stop()
        super().terminate()
        self.leave_group()
