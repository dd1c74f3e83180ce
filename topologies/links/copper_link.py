"""A copper cable as a Mininet link: topo.addLink(alice, s1, cls=CopperLink, length_km=20).

Where its delay is less than a packet takes anyhow it is a plain veth pair. A longer one is two TAP
interfaces between which the program `copper` holds every packet back: that works in every kernel,
also without `netem`.
"""

import fcntl
import os
import struct
from typing import Any

from mininet.link import Intf, Link
from mininet.node import Controller, Node, Switch

from topologies.links.keywords import refuse_unknown
from topologies.system.kernel.interfaces import TUN, quick, switch_ipv6_off
from topologies.system.machines.laying import lay
from topologies.system.processes.commands import ip
from topologies.system.processes.programs import NetworkError
from topologies.system.runs import runtime
from wire.config import Cable
from wire.network_time import NetworkTime, SteppedTime
from wire.parameters.checks import check_number
from wire.parameters.fiber import SPEED_IN_FIBER_M_PER_S
from wire.parameters.network import LEAST_MBPS, MOST_KM, MOST_MBPS
from wire.parameters.physics import BadParameter

# In wall time: from one host to the other, over two cables and a switch in user space, a packet
# takes longer than twice this.
LEAST_DELAY_S = 10e-6
TUNSETIFF, IFF_TAP, IFF_NO_PI = 0x400454CA, 0x0002, 0x1000
QUEUED_FRAMES = 10_000
ARP_TRIES = 3


def least_delay_s(time: NetworkTime) -> float:
    """Return from which delay on packets are held back; stepped time counts any."""
    return 1e-9 if isinstance(time, SteppedTime) else time.network_s(LEAST_DELAY_S)


def delay_s(length_km: float) -> float:
    """Return how long a packet is on the way; as fast as light in a fibre."""
    return length_km * 1e3 / SPEED_IN_FIBER_M_PER_S


def length_km(delay: float) -> float:
    """Return how long copper is on which a packet takes `delay` seconds."""
    return delay * SPEED_IN_FIBER_M_PER_S / 1e3


def software_delay(node: Node) -> str:
    """Return what the software of a node takes for each message that it gets; "" for none."""
    network = runtime.current()
    if node.name in network.devices:
        return network.settings.host_delay
    if node.name in network.switches:
        return network.settings.switch_agent_delay
    return network.settings.controller_delay if isinstance(node, Controller) else ""


class CopperLink(Link):
    """A cable of some length, which loses a share of the packets, and may be slow.

    `mbps` is of each direction (Mbit/s, of whole Ethernet frames); None: as fast as it goes. Raise
    BadParameter for a length, a loss or a rate that no cable has.
    """

    def __init__(
        self,
        node1: Node,
        node2: Node,
        length_km: float = 0.0,
        loss: float = 0.0,
        mbps: float | None = None,
        **params: object,
    ) -> None:
        where = f"copper {node1.name} to {node2.name}"
        refuse_unknown(where, params, type(self), Intf)
        check_number(f"{where}: length_km", length_km, 0.0, float(MOST_KM), BadParameter)
        if not isinstance(loss, int | float) or not 0 <= loss < 1:
            raise BadParameter(f"{where}: loss {loss!r} is not 0 to below 1")
        if loss and isinstance(runtime.current().time, SteppedTime):
            raise BadParameter(f"{where}: TCP repeats by the wall what is lost: no stepped time")
        if mbps is not None:
            check_number(f"{where}: mbps", mbps, LEAST_MBPS, MOST_MBPS, BadParameter)
        self.length_km, self.loss = float(length_km), float(loss)
        self.mbps, self._software = mbps, (software_delay(node1), software_delay(node2))
        super().__init__(node1, node2, **quick(params))
        network = runtime.current()
        network.copper[frozenset((node1.name, node2.name))] = delay_s(self.length_km)
        if self._is_held:
            for end in (self.intf1, self.intf2):
                if not isinstance(end.node, Switch):
                    _be_patient(end.node, str(end), network.time.wall_s(delay_s(self.length_km)))

    @property
    def _is_held(self) -> bool:
        if self.loss or self.mbps is not None or any(self._software):
            return True
        return delay_s(self.length_km) >= least_delay_s(runtime.current().time)

    def makeIntfPair(  # noqa: N802 (Mininet's name)
        self,
        intfname1: str,
        intfname2: str,
        addr1: str | None = None,
        addr2: str | None = None,
        node1: Node | None = None,
        node2: Node | None = None,
        deleteIntfs: bool = True,  # noqa: N803
    ) -> None:
        """Make both ends, and silence IPv6 at those of switches before they are up.

        They are this machine's: their addresses and routes are none of the network's, and Open
        vSwitch goes through all of them for each interface that changes.
        """
        assert node1 is not None  # Mininet's `fast` links name them
        assert node2 is not None
        ends = (intfname1, node1), (intfname2, node2)
        if self._is_held:
            self._be_held(ends)
        else:
            lay([(intfname1, addr1, node1), (intfname2, addr2, node2)])
        for name, node in ends:
            if isinstance(node, Switch):
                switch_ipv6_off(node, name)

    def _be_held(self, ends: tuple[tuple[str, Node], tuple[str, Node]]) -> None:
        """Make both ends of a cable on which packets are held back; only an object knows how."""
        (intfname1, node1), (intfname2, node2) = ends
        for node in (node1, node2):
            if getattr(node, "machine", None) is not None:
                raise NetworkError(
                    f"copper to {node} is long or slow, or loses packets: such a host is on the "
                    "first machine alone"
                )
        one, other = (tap(name, node) for name, node in ends)
        late_s = delay_s(self.length_km)
        cable = Cable(
            intfname1, intfname2, one, other, late_s, self.loss, self.mbps, *self._software
        )
        runtime.current().cables.append(cable)


def tap(name: str, node: Any) -> int:
    """Return the file of a new TAP interface in a node's namespace; it goes when that is closed."""
    try:
        file = os.open(TUN, os.O_RDWR | os.O_NONBLOCK)
        fcntl.ioctl(file, TUNSETIFF, struct.pack("16sH22x", name.encode(), IFF_TAP | IFF_NO_PI))
    except OSError as error:
        raise NetworkError(
            f"cannot make {name}, an end of copper, with {TUN}: {error.strerror}; load the kernel "
            "module tun, or make the copper short"
        ) from error
    place = "" if isinstance(node, Switch) else f" netns {node.pid}"
    ip([f"link set {name} txqueuelen {QUEUED_FRAMES}{place}"])
    return file


def _be_patient(node: Node, interface: str, one_way_s: float) -> None:
    """Let the kernel wait for answers to ARP as long as they take; TCP sees to itself."""
    round_trip_ms = round(4 * one_way_s * 1e3)  # two cables, there and back
    retrans_ms = max(1000, 1000 + round_trip_ms // ARP_TRIES)
    node.cmd(f"ip ntable change name arp_cache dev {interface} retrans {retrans_ms}")
