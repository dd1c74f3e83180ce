"""A quantum switch, with its agent."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from mininet.node import Controller

from topologies.catalogue.switch_presets import optics_of
from topologies.links.keywords import refuse_unknown
from topologies.nodes.classical_switch import ClassicalSwitch
from topologies.nodes.reached import as_reached
from topologies.nodes.tls import certify_operator, credentials
from topologies.system.kernel.interfaces import switch_ipv6_off
from topologies.system.open_vswitch import openvswitch
from topologies.system.processes.programs import Program
from topologies.system.runs.launching import launch
from topologies.system.runs.runtime import DISPATCHER
from topologies.timeouts import READY_TIMEOUT_S, RECONNECT_MS
from wire.config import AgentConfig
from wire.credentials import Credentials
from wire.parameters.checks import check_number
from wire.parameters.network import REQUIRED
from wire.parameters.physics import BadParameter
from wire.parameters.switch import OPTICS

LOOPBACK = "127.0.0.1"


class OpticalSwitch(ClassicalSwitch):
    """A quantum switch: a bridge with its agent between it and the controller.

    Optics go by keyword, as the fields of wire.parameters.switch.QuantumSwitch, or by the name of
    a preset (topologies.catalogue.switch_presets), from which what is given differs. Paths that
    differ from the others are PathOptics. Raise BadParameter if a value is out of range.
    `hardware` is "" for the simulated switch, or names an instrument, as scpi://192.0.2.7:5025;
    `hardware_ports` are the instrument's [ingress, egress] of each port that is a fibre's.
    `analysers`, `memories` and `sources` of pairs have inner ports (docs/switch-swaps.md);
    `analyser`, `detectors`, `gates`, `memory`, `emitter` and `source` are what these are like, as
    at a host.
    `controller_port` names another controller than c0, at this TCP port of 127.0.0.1, that
    programs the switch alone; c0 does not know of it then, nor of its fibres.
    The datapath ID of q1 is 0x1001, unless `dpid` is given.
    """

    first_dpid = 0x1000

    def __init__(
        self,
        name: str,
        controller_port: int | None = None,
        hardware: str = "",
        hardware_ports: Mapping[int, Sequence[int]] | None = None,
        preset: str = "",
        **params: Any,
    ) -> None:
        settings = {each: params.pop(each) for each in OPTICS & params.keys()}
        refuse_unknown(name, params, type(self), also=sorted(OPTICS))
        optics = optics_of(name, {**settings, "preset": preset})
        if controller_port is not None:
            check_number(f"{name}: controller_port", controller_port, 1, 65_535, BadParameter)
        super().__init__(name, **params)
        self.network.switches[name] = optics
        self.network.datapath_ids[name] = int(self.dpid, 16)
        self.network.token(name)
        self.controller_port = controller_port
        self.hardware = hardware
        self.hardware_ports = {str(port): [*lane] for port, lane in (hardware_ports or {}).items()}
        if controller_port is not None:
            self.network.programmed_elsewhere.add(name)
            del self.network.bridges[name]
        self.program: Program | None = None

    def lay(self) -> None:
        """Make the bridge with its ports, inner ones included: patches that lead nowhere."""
        stands = self.stands
        super().lay()
        command: list[str] = []
        for number, inner in self.network.switches[self.name].inner_ports.items():
            port = inner.name(self.name)
            command += ["--", "add-port", self.name, port, "--", "set", "interface", port]
            command += ["type=patch", "options:peer=none", f"ofport_request={number}"]
        if command and not stands:
            openvswitch.change(*command)

    def launch(self, controllers: list[Controller]) -> None:
        """Start the bridge and its agent ahead of `start`, which then only has to wait."""
        if self.program is not None:
            return
        network, config = self.network, self.agent_config(controllers)
        self.lay()
        # Programs that ask for the bridge by name, as ovs-ofctl does, reach the agent.
        Path(config.programs).replace(config.management)
        self._targets = [
            f"unix:{config.listening(number)}" for number in range(len(config.controllers))
        ]
        switch_ipv6_off(self, self.name)
        for program in network.programs:
            if program.name == DISPATCHER:  # the agent asks it at once
                program.wait_for("ready", READY_TIMEOUT_S)
        self.program = launch(network, f"{self.name}-agent", "qswitch_agent", config)

    def agent_config(self, controllers: list[Controller]) -> AgentConfig:
        """Return the agent's configuration; all fibres are made by now."""
        network, optics = self.network, self.network.switches[self.name]
        return AgentConfig(
            switch=self.name,
            # Open vSwitch connects to Unix sockets of its own folder alone.
            listen=str(openvswitch.agent_socket(self.name)),
            controllers=self._controllers(controllers),
            management=network.socket(f"{self.name}-bridge"),
            needs_copies=network.settings.metadata_at_switch == REQUIRED
            and self.controller_port is None,
            programs=str(openvswitch.management(self.name)),
            dispatcher=network.socket(DISPATCHER),
            token=network.token(self.name),
            fiber_ports=sorted(
                int(end.port)
                for fiber in network.fibers
                for end in (fiber.a, fiber.b)
                if end.node == self.name
            ),
            analysers=optics.analysers,
            memories=optics.memories,
            sources=optics.sources,
            emitters=optics.emitters,
            parts=optics.parts,
            hardware=self.hardware,
            hardware_ports=self.hardware_ports,
            credentials=self._credentials(),
            gnmi=self._gnmi(),
        )

    def start(self, controllers: list[Controller]) -> None:
        """Start the bridge and its agent, then let the bridge connect to the agent.

        The target is set when the agent answers, because Open vSwitch would wait a second
        before it tried again; no flow can be there earlier.
        """
        self.launch(controllers)
        assert self.program is not None
        self.program.wait_for("ready", READY_TIMEOUT_S)
        names = [""] if self.controller_port is not None else [each.name for each in controllers]
        self._obey(
            {
                target: self._patience(name) | {"max_backoff": RECONNECT_MS}
                for target, name in zip(self._targets, names, strict=True)
            }
        )

    def _credentials(self) -> Credentials | None:
        if not self.network.settings.tls or self.controller_port is not None:
            return None
        return credentials(self.network, self.name, {"localhost": LOOPBACK})

    def _gnmi(self) -> str:
        network = self.network
        if not network.settings.gnmi:
            return ""
        certify_operator(network)
        return network.socket(f"{self.name}-gnmi")

    def _controllers(self, controllers: list[Controller]) -> list[str]:
        if self.controller_port is not None:
            return [f"127.0.0.1:{self.controller_port}"]
        reached = [as_reached(controller, self.name) for controller in controllers]
        return [f"{controller.IP()}:{controller.port}" for controller in reached]

    def stop(self, deleteIntfs: bool = True) -> None:  # noqa: N803 (Mininet's name)
        self._end_agent()
        super().stop(deleteIntfs)

    def terminate(self) -> None:
        self._end_agent()
        super().terminate()

    def _end_agent(self) -> None:
        """End the agent, whose end is not a fault then."""
        if self.program:
            self.network.programs.remove(self.program)
            self.program.stop()
            self.program = None
            openvswitch.remove_agent_sockets(self.name)
