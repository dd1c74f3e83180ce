"""The folder of a NetQASM application whose roles are on other machines, too: copies go there.

Files of programs there, and logs of the SDK, come back at the end.
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path, PurePosixPath

from topologies.networks.network import Network
from topologies.system.machines.machine import Machine
from topologies.system.machines.packing import pack, unpacked, write
from wire.packed_folder import Entry

COPY = "application"  # in the private folder


@dataclass
class CarriedApplication:
    """An application, and the copies of its folder on other machines."""

    path: Path  # its folder, or a program in it
    hosts: Collection[str]  # of its roles
    runs: Path  # folder of what runs leave, which does not go along
    _packed: bytes = b""
    _copies: dict[str, Path] = field(default_factory=dict)  # by host: its folder there

    @property
    def folder(self) -> Path:
        return self.path.parent if self.path.is_file() else self.path

    def prepare(self, places: Mapping[str, Machine]) -> None:
        """Pack it if a role is on another machine; raise NetworkError for what cannot go there."""
        if not places.keys().isdisjoint(self.hosts):
            self._packed = pack(self.folder, without=[self.runs])

    def path_on(self, network: Network, host: str) -> Path:
        if host not in network.runtime.places:
            return self.path
        self._copies[host] = network.share_folder(host, self._packed, f"{COPY}-{host}")
        return self._copies[host] / self.path.relative_to(self.folder)

    def come_back(self, network: Network, folder: Path) -> None:
        """Bring what the SDK has logged to where it is of hosts here.

        Files that programs have written go into a folder of the host in this one.
        """
        for host, copy in self._copies.items():
            logs = network.runtime.written_folder(host)
            write(network.bring_folder(host, logs), logs)
            if new := new_of(network.bring_folder(host, copy), unpacked(self._packed)):
                write(new, folder / host)


def new_of(after: Collection[Entry], before: Collection[Entry]) -> list[Entry]:
    contents = {_content(each) for each in before}
    names = {each.name for each in after if _content(each) not in contents}
    above = {str(parent) for name in names for parent in PurePosixPath(name).parents}
    return [each for each in after if each.name in names | above]


def _content(entry: Entry) -> Entry:
    return replace(entry, changed_ns=0)
