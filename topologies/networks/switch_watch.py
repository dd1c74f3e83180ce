"""Watches the switches of a network: their bridges, links and flow entries on this machine.

A deletion of one of these is the cause; programs that end, or wait in vain, because of it are
not. Interfaces also go with a daemon or a shell that ends, a moment before that is seen.
"""

import re
import time
from collections.abc import Iterable, Iterator

from mininet.link import Intf

from topologies.links.fiber import Channel
from topologies.nodes.classical_switch import ClassicalSwitch
from topologies.system.kernel import interfaces
from topologies.system.processes.commands import run
from topologies.system.processes.programs import NetworkError
from topologies.timeouts import OPENVSWITCH_COMMAND_TIMEOUT_S

FLOW_COUNT = re.compile(r"flow_count=(\d+)")


class SwitchWatch:
    """Knows which interfaces are there when it is made, and which have gone since."""

    def __init__(self, nodes: Iterable[object] = ()) -> None:
        self._switches = [node for node in nodes if isinstance(node, ClassicalSwitch)]
        self._there = interfaces.all_here()
        self._gone: dict[str, float] = {}  # since when

    def require_interfaces(self, patience_s: float) -> None:
        """Raise NetworkError for an interface that was seen to be gone for so long."""
        now, here = time.monotonic(), interfaces.all_here()
        gone = {text for name, text in self._due() if name in self._there - here}
        self._gone = {text: self._gone.get(text, now) for text in gone}
        for text, since in sorted(self._gone.items()):
            if now - since >= patience_s:
                raise NetworkError(f"{text} was deleted in mid-run")

    def require_flows(self) -> None:
        """Raise NetworkError for a bridge without flow entries, which drops all packets."""
        for switch in self._laid():
            command = "ovs-ofctl", "-O", "OpenFlow14", "dump-aggregate", switch.name
            counted = FLOW_COUNT.search(run(*command, timeout_s=OPENVSWITCH_COMMAND_TIMEOUT_S))
            if counted and not int(counted[1]):
                raise NetworkError(
                    f"bridge {switch.name} has no flow entries, and drops all packets: they were "
                    "deleted (as by ovs-ofctl del-flows), or its controller has set none"
                )

    def _laid(self) -> Iterator[ClassicalSwitch]:
        """Yield the switches that nobody has stopped, as by `switch s1 stop`."""
        yield from (switch for switch in self._switches if switch.stands)

    def _due(self) -> Iterator[tuple[str, str]]:
        for switch in self._laid():
            yield switch.name, f"bridge {switch.name}"
            yield from ((str(port), described(port)) for port in switch.intfList())


def described(port: Intf) -> str:
    if port.link is None:
        return f"interface {port}"
    kind = "fibre" if isinstance(port.link, Channel) else "copper link"
    return f"the {kind} {port.link.intf1} to {port.link.intf2}"
