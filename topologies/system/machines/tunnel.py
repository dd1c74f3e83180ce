"""The ends of links between machines: VXLAN from one to one other, the kernel's if it has that.

Each link has an identifier (VNI) of its own. Wrapped packets travel between addresses of
the machine on which the interface was made, whatever namespace it is moved to.
"""

from dataclasses import dataclass

from topologies.system.kernel.interfaces import keep_segments
from topologies.system.machines import user_space
from topologies.system.machines.user_space import PORT
from topologies.system.processes.commands import ip
from topologies.system.processes.programs import NetworkError

KERNEL, OPEN_VSWITCH = TUNNELS = "kernel", "open-vswitch"
NO_SUCH_KIND = "Unknown device type"  # as ip(8) says of a kernel that has none
OVERHEAD_BYTES = 50  # of Ethernet, IPv4, UDP and VXLAN
MOST_IDENTIFIER = 1 << 24


@dataclass(frozen=True)
class TunnelEnd:
    name: str
    hardware_address: str | None
    identifier: int
    local: str  # IPv4 of this machine, and of the other one
    remote: str
    mtu: int
    by: str = ""  # one of TUNNELS; "": the kernel, or else Open vSwitch

    def make(self, pid: int | None) -> None:
        """Make it, in the network namespace of a process if one is given; or raise NetworkError."""
        if self.by == OPEN_VSWITCH or not self._made_by_kernel():
            ends = self.local, self.remote
            user_space.make(self.name, self.mtu, self.identifier, ends, pid is not None)
        if self.hardware_address is not None:
            ip([f"link set {self.name} address {self.hardware_address}"])
        keep_segments(self.name)
        if pid is not None:
            ip([f"link set {self.name} netns {pid}"])

    def _made_by_kernel(self) -> bool:
        """Make it, or tell that this kernel has no VXLAN, unless it is to be the kernel's."""
        place = f"local {self.local} remote {self.remote} dstport {PORT} nolearning"
        kind = f"mtu {self.mtu} type vxlan id {self.identifier}"
        try:
            ip([f"link add {self.name} {kind} {place}"])
        except NetworkError as error:
            if self.by == KERNEL or NO_SUCH_KIND not in str(error):
                raise
            return False
        return True
