"""Our controller."""

from dataclasses import replace
from pathlib import Path
from typing import Any

from mininet.node import Host, Node

from topologies.links.fiber import FiberLink
from topologies.links.keywords import refuse_unknown
from topologies.links.management import lay_management
from topologies.nodes.addresses import free_address
from topologies.nodes.classical_switch import ClassicalSwitch
from topologies.nodes.copper import connect_copper
from topologies.nodes.node import QuantumNode
from topologies.nodes.optical_switch import OpticalSwitch
from topologies.nodes.reached import ManagedController
from topologies.nodes.tls import ENTRANCE, certify_bridges, entrance
from topologies.system.kernel.interfaces import repeat_nothing, within
from topologies.system.processes.programs import Program
from topologies.system.runs import runtime
from topologies.system.runs.launching import EarlyStart, launch
from topologies.system.runs.runtime import CONSOLE
from topologies.timeouts import READY_TIMEOUT_S
from wire.config import ControllerConfig, Station
from wire.controller_lines import RECORD
from wire.lldp import period_s
from wire.network_time import SteppedTime
from wire.parameters.network import ControllerSettings, part

LOOPBACK, ANYWHERE = "127.0.0.1", "0.0.0.0"  # noqa: S104 (of its own namespace)
STATE = "state"  # folder in which the controller keeps what its successor must know


class QuantumController(QuantumNode, ManagedController):
    """`c0`: our controller apps on Ryu or os-ken, in a namespace of their own.

    Mininet's own command line sets it up so: --controller quantum,rest=127.0.0.1:8080,
    apps=ryu.app.ofctl_rest (further modules behind a +).
    """

    def __init__(
        self,
        name: str,
        framework: str = "",
        policy: str = "",
        rest: str = "",
        apps: str = "",
        **params: object,
    ) -> None:
        refuse_unknown(name, params, type(self))
        network = runtime.current()
        policy = str(Path(policy).resolve()) if policy else ""
        chosen: dict[str, Any] = {"controller": framework, "policy": policy, "rest": rest}
        network.settings = replace(
            network.settings,
            apps=(*network.settings.apps, *filter(None, apps.split("+"))),
            **{name: value for name, value in chosen.items() if value},
        )
        self.network = network
        self.addresses: dict[str, str] = {}  # on the management network, by switch
        settings: dict[str, object] = {
            "port": self.network.settings.openflow_port,
            "inNamespace": True,
        }
        settings["protocol"] = "ssl" if self.network.settings.tls else "tcp"
        super().__init__(name, **{**params, **settings})
        if isinstance(network.time, SteppedTime):
            within(self, repeat_nothing)
        self._early: EarlyStart | None = self._begin()
        self._launched = False
        self._entrance: Program | None = None  # before it, for switches that come by TLS

    def checkListening(self) -> None:  # noqa: N802 (Mininet's name)
        """Let the controller itself find out whether its port is free."""

    @property
    def program(self) -> Program | None:
        return self._early.program if self._early else None

    def _begin(self) -> EarlyStart:
        """Let the controller load its framework, which takes longest of all."""
        arguments = ["--framework", self.network.settings.controller]
        return EarlyStart(self.network, self.name, "controller_apps", arguments, self)

    def launch(self) -> None:
        """Start the controller ahead of `start`, which then only has to wait."""
        if self._launched:
            return
        self._early = self._early or self._begin()
        network = self.network
        if not self.addresses:
            self.addresses = lay_management(self, network.bridges, network)
            connect_copper(network)
        if network.settings.tls:
            self._enter()
        self._early.go_on(self.controller_config())
        self._launched = True

    def controller_config(self) -> ControllerConfig:
        """Return the controller's configuration; all nodes and fibres are made by now."""
        network = self.network
        return ControllerConfig(
            listen=f"{LOOPBACK if network.settings.tls else ANYWHERE}:{self.port}",
            framework=network.settings.controller,
            quantum_switches=dict(network.datapath_ids),
            record=str(network.private_file(RECORD)),
            address=free_address(network.addresses.values(), network.prefix_length),
            device_keys=network.device_keys,
            addresses={host: network.addresses[host] for host in network.device_keys},
            stations=[station for host in network.hosts for station in stations_of(host)],
            trunks=[port for bridge in network.bridges.values() for port in trunks_of(bridge)],
            console=network.socket(CONSOLE),
            rest_token=network.rest_token() if network.settings.rest else "",
            state=str(network.folder / STATE),
            announcement_period_s=period_s(len(network.fibers)),
            **part(ControllerSettings, network.settings),
        )

    def _enter(self) -> None:
        """Let switches come in by TLS alone."""
        network = self.network
        certify_bridges(network)
        config = entrance(network, self.name, self.port, self.addresses)
        self._entrance = launch(network, ENTRANCE, "controller_apps.tls", config, self)

    def IP(self, intf: object = None) -> str:  # noqa: N802 (Mininet's name)
        """Return an address on the management network, if it has one."""
        return next(iter(self.addresses.values()), str(self.ip))

    def start(self) -> None:
        """Start the controller and wait until switches can connect."""
        self.launch()
        assert self._early is not None
        self._early.program.wait_for("ready", READY_TIMEOUT_S)
        if self._entrance is not None:
            self._entrance.wait_for("ready", READY_TIMEOUT_S)

    def stop(self, *_args: object, **_params: object) -> None:
        if self._early:
            self._early.stop()
            self._early, self._launched = None, False
        if self._entrance is not None:
            self._entrance.stop()
            self._entrance = None
        self.terminate()


def is_copper_switch(node: Node) -> bool:
    """Return whether a node is a switch of copper, whatever its name; a quantum switch is not."""
    return isinstance(node, ClassicalSwitch) and not isinstance(node, OpticalSwitch)


def trunks_of(switch: ClassicalSwitch) -> list[tuple[int, int]]:
    """Return the ports of a switch with copper to another one that has the same controller."""
    bridges = switch.network.bridges.values()
    return [
        (int(switch.dpid, 16), switch.ports[interface])
        for interface in switch.intfList()
        if interface.link is not None
        and not isinstance(interface.link, FiberLink)
        and {interface.link.intf1.node, interface.link.intf2.node} <= {*bridges}
    ]


def stations_of(host: Host) -> list[Station]:
    """Return where a host is on copper at classical switches."""
    address, mac = str(host.params["ip"]).partition("/")[0], host.params.get("mac")
    ends = [
        (interface, end)
        for interface in host.intfList()
        if interface.link is not None
        for end in (interface.link.intf1, interface.link.intf2)
        if is_copper_switch(end.node)
    ]
    return [
        Station(int(end.node.dpid, 16), end.node.ports[end], mac or interface.updateMAC(), address)
        for interface, end in ends
    ]
