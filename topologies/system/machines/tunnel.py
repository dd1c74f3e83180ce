"""The ends of links between machines: kernel VXLAN from one machine to one other.

Each link has an identifier (VNI) of its own. What an interface wraps travels between addresses
of the machine that it was made on, whatever namespace it is moved to.
"""

import subprocess
from dataclasses import dataclass

from topologies.system.kernel.interfaces import keep_segments
from topologies.system.processes.programs import NetworkError
from topologies.timeouts import COMMAND_TIMEOUT_S

PORT = 4789  # of VXLAN (RFC 7348)
OVERHEAD_BYTES = 50  # of Ethernet, IPv4, UDP and VXLAN
MOST_IDENTIFIER = 1 << 24


@dataclass(frozen=True)
class TunnelEnd:
    """One end of a link."""

    name: str
    hardware_address: str | None
    identifier: int
    local: str  # IPv4 of this machine, and of the other one
    remote: str
    mtu: int

    def make(self, pid: int | None) -> None:
        """Make it, in the network namespace of a process if one is given; or raise NetworkError."""
        place = ["local", self.local, "remote", self.remote, "dstport", str(PORT), "nolearning"]
        made = ["add", self.name, "mtu", str(self.mtu)]
        if self.hardware_address is not None:
            made += ["address", self.hardware_address]
        _ip_link(*made, "type", "vxlan", "id", str(self.identifier), *place)
        keep_segments(self.name)
        if pid is not None:
            _ip_link("set", self.name, "netns", str(pid))


def _ip_link(*words: str) -> None:
    done = subprocess.run(
        ["ip", "link", *words],
        capture_output=True,
        text=True,
        check=False,
        timeout=COMMAND_TIMEOUT_S,
        start_new_session=True,
    )
    if done.returncode:
        raise NetworkError(f"ip link {' '.join(words)}: {done.stderr.strip()}")
