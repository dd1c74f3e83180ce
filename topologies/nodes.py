"""Mininet node types of a quantum network: each starts its program and ends it again."""

import os
import shlex
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from mininet.node import Controller, Host, OVSSwitch

from topologies import openvswitch, runtime
from topologies.addresses import broadcast, free_address
from topologies.causality import ways_of_news
from topologies.confinement import ConfinedNode
from topologies.fiber import python_file, qnics
from topologies.interfaces import finish_checksums, network_of, switch_ipv6_off
from topologies.keywords import refuse_unknown
from topologies.launching import EarlyStart, launch
from topologies.management import lay_management
from topologies.programs import ROOT, Program, python
from topologies.runtime import CONSOLE, DISPATCHER, EVENT_CAPTURE, EVENT_LOG, Runtime
from topologies.shells import ShellWatcher
from wire.config import (
    CONTROLLER,
    DISPATCHER_PORT,
    LIGHT,
    STANDING,
    AgentConfig,
    BadConfig,
    ControllerConfig,
    CopperConfig,
    DispatcherConfig,
    HostConfig,
    QuantumSwitch,
    Station,
)
from wire.controller_record import RECORD
from wire.features import EMIT
from wire.parameters.network import ControllerSettings, DispatcherSettings, part
from wire.parameters.physics import (
    BadParameter,
    BellAnalyser,
    Detectors,
    Device,
    Gates,
    Memory,
    PairSource,
)
from wire.parameters.switch import OPTICS

READY_TIMEOUT_S = 20.0
COPPER = "copper"  # the program that holds packets back
STATE = "state"  # folder in which the controller keeps what its successor must know
DEFAULT_PREFIX_LENGTH = 8  # Mininet's
PATIENCE = 8  # times the way to the controller
RECONNECT_MS = 1000  # between a bridge's attempts to find its controller, at most


def connect_copper(network: Runtime) -> None:
    """Start what holds packets back on long copper, if there is some, before any are sent."""
    if not network.cables:
        return
    files = [file for cable in network.cables for file in (cable.a_fd, cable.b_fd)]
    simulation = network.dispatcher.partition(":")[0]
    config = CopperConfig(list(network.cables), simulation, network.settings.seed)
    program = launch(network, COPPER, "copper", config, descriptors=files)
    for file in files:
        os.close(file)  # the program has them
    network.cables.clear()
    program.wait_for("ready", READY_TIMEOUT_S)


class QuantumNode(ShellWatcher):
    """A node of a network of ours, which says when what sets it up must not take long."""

    network: Runtime

    @property
    def hurried(self) -> bool:  # type: ignore[override]
        """Whether the network starts or ends just now."""
        return self.network.hurried

    def startShell(self, mnopts: str | None = None) -> None:  # noqa: N802 (Mininet's name)
        """Start the shell; in a network of its own IPv6 is off from the beginning."""
        super().startShell(mnopts)
        if self.inNamespace:
            switch_ipv6_off(self, "all", "default")

    def find_our_programs(self) -> None:
        """Let `qmn spy`, and `python` with our packages, work in the node's shell."""
        folders = f"{ROOT / 'bin'}:{Path(python()).parent}"
        self.cmd(f'export PYTHONPATH="{ROOT}" PATH="{folders}:$PATH"')


def stations_of(host: Host) -> list[Station]:
    """Return where a host is on copper at classical switches."""
    address, mac = str(host.params["ip"]).partition("/")[0], host.params.get("mac")
    ends = [
        (interface, end)
        for interface in host.intfList()
        if interface.link is not None
        for end in (interface.link.intf1, interface.link.intf2)
        if isinstance(end.node, ClassicalSwitch) and not isinstance(end.node, OpticalSwitch)
    ]
    return [
        Station(int(end.node.dpid, 16), end.node.ports[end], mac or interface.updateMAC(), address)
        for interface, end in ends
    ]


def covered_folders(network: Runtime) -> list[Path]:
    """Return the folders with what hosts are not to see of a run, or of others on this machine."""
    kept = [Path(network.settings.keys)] if network.settings.keys else []
    return [runtime.RUNTIME_ROOT, openvswitch.RUN_FOLDER, network.logs.resolve(), *kept]


class ClassicalHost(QuantumNode, ConfinedNode, Host):
    """A host whose interfaces suit a switch in user space: no IPv6, finished checksums.

    What people start on it sees its own processes, and of the run its own folder; with
    `confined=False` it sees all, and can mount, as on a host of Mininet's.
    """

    def __init__(self, name: str, confined: bool = True, **params: object) -> None:
        refuse_unknown(name, params, type(self))
        self.network = runtime.current()
        self.confined = confined
        self.program: Program | None = None
        super().__init__(name, **params)
        self.network.hosts.append(self)
        self.network.addresses[name], _, bits = str(params["ip"]).partition("/")
        self.network.prefix_length = int(bits or DEFAULT_PREFIX_LENGTH)

    def config(self, **params: object) -> dict[str, object]:
        """Configure the interfaces."""
        result: dict[str, object] = super().config(**params)
        if openvswitch.datapath() == "user":
            with network_of(self):
                finish_checksums(str(self.defaultIntf()))
        if self.confined:
            self.confine(self.shown_folders(), covered_folders(self.network))
        self.find_our_programs()
        return result

    def shown_folders(self) -> list[Path]:
        """Return the folders of the run that are this host's own."""
        return []

    def terminate(self) -> None:
        """End the host's program, then the host."""
        if self.program:
            self.program.stop()
        super().terminate()


class DispatcherHost(ClassicalHost):
    """`ed`: runs the dispatcher, which holds every qubit of the network.

    Who is on it sees the whole run, as `qmn spy` does there.
    """

    def __init__(self, name: str, confined: bool = False, **params: object) -> None:
        super().__init__(name, confined, **params)
        self.network.dispatcher = f"{self.network.addresses[name]}:{DISPATCHER_PORT}"

    def config(self, **params: object) -> dict[str, object]:
        """Configure the interfaces and start the dispatcher."""
        result = super().config(**params)
        network = self.network
        config = DispatcherConfig(
            listen=network.dispatcher,
            socket=network.socket(DISPATCHER),
            seed=network.settings.seed,
            tokens=network.tokens,
            fibers=network.fibers,
            switches=list(network.switches.values()),
            event_log=str(network.private_file(EVENT_LOG)) if network.events else "",
            record=str(network.logs / "dispatcher.record") if network.record else "",
            qasm=str(network.private_file("quantum.qasm")) if network.qasm else "",
            devices=network.devices,
            event_capture=str(network.private_file(EVENT_CAPTURE)) if network.events else "",
            news_s=ways_of_news(network),
            **part(DispatcherSettings, network.settings),
        )
        self.program = launch(network, DISPATCHER, "dispatcher", config, self)
        return result

    def terminate(self) -> None:
        """End the dispatcher, then the copper to it, then the host."""
        if self.program:
            self.program.stop()
        for program in self.network.programs:
            if program.name == COPPER:
                program.stop()
        super().terminate()


MOST_PAIR_RATE_HZ = 50_000_000
PARTS = ("source", "memory", "detectors", "analyser", "gates")


def device_of(name: str, params: Mapping[str, Any]) -> Device:
    """Return the device that the parameters of a QuantumHost describe; raise BadParameter."""
    device = params.get("device")
    if not isinstance(device, Device | None):
        raise BadParameter(f"{name}: device {device!r} is not a Device")
    parts = {part: params.get(part) for part in PARTS}
    given = {
        part: value
        for part, value in parts.items()
        if value is not None and not isinstance(value, bool)
    }
    described = replace(device or Device(), **given)
    described.check(name)
    return described


class QuantumHost(ClassicalHost):
    """A host with a QNIC: runs the three-layer stack.

    `source=True` makes pairs, for all hosts that do not name another by `pairs_from`. What its
    hardware is like goes by parts, as detectors=Detectors(efficiency=0.8), or as one `device`;
    `source` may be a PairSource. `light` says who grants it (wire.config.LIGHT). Raise
    BadParameter for what no hardware is like.
    `qnic` is "" for simulated hardware, or "path/to/file.py:ClassName" of a class of one's own
    (hosts/hardware/choice.py), which is made with `qnic_parameters`.
    """

    def __init__(
        self,
        name: str,
        source: bool | PairSource = False,
        pairs_from: str = "",
        device: Device | None = None,
        memory: Memory | None = None,
        detectors: Detectors | None = None,
        analyser: BellAnalyser | None = None,
        gates: Gates | None = None,
        light: str = CONTROLLER,
        qnic: str = "",
        qnic_parameters: Mapping[str, Any] | None = None,
        confined: bool = True,
        **params: object,
    ) -> None:
        if light not in LIGHT:
            raise BadParameter(f"{name}: light {light!r}: choose one of {', '.join(LIGHT)}")
        parts = {"memory": memory, "detectors": detectors, "analyser": analyser, "gates": gates}
        described = device_of(name, {"source": source, "device": device, **parts})
        self.qnic = python_file(f"{name}: qnic", qnic)
        self.qnic_parameters = dict(qnic_parameters or {})
        super().__init__(name, confined, **params)
        self.network.devices[name] = described
        self.network.token(name)
        self.pairs_from = pairs_from
        self.light = light
        self.network.device_key(name)
        if source:
            self.network.source = name

    def shown_folders(self) -> list[Path]:
        """Return those of its stack's socket and of its keys."""
        return [self.network.own_folder(self.name), Path(self.network.key_folder(self.name))]

    def config(self, **params: object) -> dict[str, object]:
        """Configure the interfaces and start the stack."""
        result = super().config(**params)
        network = self.network
        config = HostConfig(
            name=self.name,
            address=network.addresses[self.name],
            qnics=qnics(self),
            dispatcher=network.dispatcher,
            token=network.token(self.name),
            socket=network.socket(self.name),
            hosts_file=network.hosts_file(),
            source=self.pairs_from or network.source,
            seed=network.settings.seed,
            report_to=broadcast(network.addresses.values(), network.prefix_length),
            device_key=network.device_key(self.name),
            analyser=network.devices[self.name].analyser.kind,
            qnic=self.qnic,
            qnic_parameters=self.qnic_parameters,
            features=network.devices[self.name].features.value,
            memory_qubits=network.devices[self.name].memory.capacity,
            multi_photon=network.devices[self.name].source.multi_photon,
            intensities=list(network.devices[self.name].source.intensities),
            pair_secrets=network.secrets_folder(),
            pair_rate_hz=pair_rate_hz(network.devices.values()),
            t1_s=network.devices[self.name].memory.t1_s,
            t2_s=network.devices[self.name].memory.t2_s,
            keys=network.key_folder(self.name),
            light=self.light,
        )
        if self.light == STANDING:
            require_unrotated(network.switches.values())
        self.program = launch(network, self.name, "hosts", config, self)
        self.cmd(f'export QMN_STACK="{config.socket}"')
        return result


def pair_rate_hz(devices: Iterable[Device]) -> int:
    """Return the rate at which every source of a network can make pairs."""
    rates = [device.source.max_rate_hz for device in devices if EMIT in device.features]
    return max(1, int(min([MOST_PAIR_RATE_HZ, *rates])))


def require_unrotated(switches: Iterable[QuantumSwitch]) -> None:
    """Raise BadConfig for a switch that rotates light: only our controller tells hosts of it."""
    for switch in switches:
        if switch.rotation or any(path.rotation for path in switch.paths):
            raise BadConfig(
                f"{switch.name} rotates light, and with light=standing nobody tells the hosts; "
                "take rotation=0 or light=controller"
            )


class ClassicalSwitch(QuantumNode, OVSSwitch):
    """An Open vSwitch bridge that speaks OpenFlow 1.4 and forwards only what it is told."""

    def __init__(self, name: str, **params: object) -> None:
        refuse_unknown(name, params, type(self))
        self.network = runtime.current()
        settings = {
            "datapath": openvswitch.datapath(),
            "protocols": "OpenFlow14",
            "failMode": "secure",
            "reconnectms": RECONNECT_MS,
        }
        super().__init__(name, **{**params, **settings})
        self._laid = False
        self.network.bridges[name] = self

    @classmethod
    def isOldOVS(cls) -> bool:  # noqa: N802 (Mininet's name)
        """Say that Open vSwitch is of this century, without asking it."""
        return False

    @classmethod
    def batchShutdown(  # noqa: N802 (Mininet's name)
        cls, switches: Sequence["ClassicalSwitch"], run: object = None
    ) -> Sequence["ClassicalSwitch"]:
        """Delete bridges together, by a command that ends also where Open vSwitch has ended."""
        del run
        for switch in switches:
            switch.hang_up()
        try:
            openvswitch.delete(*(switch.name for switch in switches))
        finally:
            for switch in switches:
                switch.terminate()
        return switches

    def bridgeOpts(self) -> str:  # noqa: N802 (Mininet's name)
        """Return the bridge's options; the one that marks it as ours comes with its birth."""
        return f"{super().bridgeOpts()} {openvswitch.OWNER}={self.network.name}"

    @classmethod
    def batchStartup(  # noqa: N802 (Mininet's name)
        cls, switches: Sequence["ClassicalSwitch"], run: object = None
    ) -> Sequence["ClassicalSwitch"]:
        """Have all of them started already, where Mininet would run what they have put off."""
        del run
        return switches

    def start(self, controllers: list[Controller]) -> None:
        """Start the bridge; whichever the controller is, copper has its length by then.

        It looks for our own controller on the management network.
        """
        connect_copper(self.network)
        self.lay()
        reached = [_reached(controller, self.name) for controller in controllers]
        self._obey(
            {
                f"{each.protocol}:{each.IP()}:{each.port}": self._patience(each.name)
                for each in reached
            }
        )
        self.find_our_programs()

    def lay(self) -> None:
        """Make the bridge with its ports, which nobody programs yet."""
        if not self._laid:
            super().start([])
            self._laid = True

    def _obey(self, targets: Mapping[str, Mapping[str, int]]) -> None:
        """Let controllers program the bridge, each with its own settings in Open vSwitch."""
        words: list[str] = []
        for number, (target, settings) in enumerate(targets.items()):
            words += ["--", f"--id=@{self.name}c{number}", "create", "Controller"]
            words += [f'target="{target}"', *(f"{key}={value}" for key, value in settings.items())]
        rows = ",".join(f"@{self.name}c{number}" for number in range(len(targets)))
        openvswitch.change(*words, "--", "set", "bridge", self.name, f"controller=[{rows}]")

    def _patience(self, controller: str) -> dict[str, int]:
        """Let Open vSwitch wait as long for a controller as the way there takes."""
        way_s = self.network.copper.get(frozenset((controller, self.name)), 0.0)
        wait_ms = round(1e3 * PATIENCE * self.network.time.wall_s(way_s))
        if wait_ms < RECONNECT_MS:
            return {"max_backoff": RECONNECT_MS}  # Open vSwitch's own is 8 s
        return {"max_backoff": wait_ms, "inactivity_probe": wait_ms}

    def stop(self, deleteIntfs: bool = True) -> None:  # noqa: N803 (Mininet's name)
        """Take the bridge away, as `switch s1 stop` does; `start` brings it back.

        Mininet would end the node's shell, too, and could not start it again.
        """
        openvswitch.delete(self.name)
        self._laid = False
        if deleteIntfs:
            self.deleteIntfs()

    def dpctl(self, *arguments: str) -> str:
        """Run ovs-ofctl in the bridge's version of OpenFlow."""
        command, *rest = arguments
        return self.cmd("ovs-ofctl -O OpenFlow14", command, self, *rest)

    def vsctl(self, *arguments: str, **_options: object) -> str:
        """Run ovs-vsctl; unlike Mininet's own, say so if it fails."""
        return openvswitch.change(*shlex.split(" ".join(map(str, arguments))))


class OpticalSwitch(ClassicalSwitch):
    """A quantum switch: a bridge with its agent between it and the controller.

    Optics go by keyword, as the fields of wire.parameters.switch.QuantumSwitch; paths that
    differ from the others are PathOptics there. Raise BadParameter for what no switch can have.
    `hardware` is "" for the simulated switch, or names an instrument, as scpi://192.0.2.7:5025;
    `hardware_ports` are the instrument's [ingress, egress] of each port that is a fibre's.
    `controller_port` names another controller than c0, at this TCP port of 127.0.0.1, that
    programs the switch alone; c0 does not know of it then, nor of its fibres.
    """

    def __init__(
        self,
        name: str,
        controller_port: int | None = None,
        hardware: str = "",
        hardware_ports: Mapping[int, Sequence[int]] | None = None,
        **params: Any,
    ) -> None:
        given = {each: params.pop(each) for each in OPTICS & params.keys()}
        refuse_unknown(name, params, type(self), also=sorted(OPTICS))
        optics = QuantumSwitch(name, **{**given, "paths": list(given.get("paths", ()))})
        optics.check()
        if controller_port is not None and not 0 < controller_port < 1 << 16:
            raise BadParameter(f"{name}: controller_port {controller_port} is not 1 to 65535")
        super().__init__(name, **params)
        self.network.switches[name] = optics
        self.network.datapath_ids[name] = int(self.dpid, 16)
        self.network.token(name)
        self.controller_port = controller_port
        self.hardware = hardware
        self.hardware_ports = {str(port): [*own] for port, own in (hardware_ports or {}).items()}
        if controller_port is not None:
            self.network.programmed_elsewhere.add(name)
            del self.network.bridges[name]
        self.program: Program | None = None

    def launch(self, controllers: list[Controller]) -> None:
        """Start the bridge and its agent ahead of `start`, which then only has to wait."""
        if self.program is not None:
            return
        network, commanding = self.network, self._controllers(controllers)
        config = AgentConfig(
            switch=self.name,
            # Open vSwitch connects to Unix sockets of its own folder alone.
            listen=str(openvswitch.agent_socket(self.name)),
            controllers=commanding,
            management=network.socket(f"{self.name}-bridge"),
            programs=str(openvswitch.RUN_FOLDER / f"{self.name}.mgmt"),
            dispatcher=network.socket(DISPATCHER),
            token=network.token(self.name),
            fiber_ports=sorted(
                int(end.port)
                for fiber in network.fibers
                for end in (fiber.a, fiber.b)
                if end.node == self.name
            ),
            hardware=self.hardware,
            hardware_ports=self.hardware_ports,
        )
        self.lay()
        # Who asks for the bridge by name, as ovs-ofctl does, comes to the agent.
        Path(config.programs).replace(config.management)
        self._targets = [f"unix:{config.listening(number)}" for number in range(len(commanding))]
        switch_ipv6_off(self, self.name)
        for program in network.programs:
            if program.name == DISPATCHER:  # the agent asks it at once
                program.wait_for("ready", READY_TIMEOUT_S)
        self.program = launch(network, f"{self.name}-agent", "qswitch_agent", config)

    def start(self, controllers: list[Controller]) -> None:
        """Start the bridge and its agent, then let the bridge connect to the agent.

        The target is set when the agent answers, because Open vSwitch would wait a second
        before it tried again; no flow can be there earlier.
        """
        self.launch(controllers)
        assert self.program is not None
        self.program.wait_for("ready", READY_TIMEOUT_S)
        self._obey({target: {"max_backoff": RECONNECT_MS} for target in self._targets})

    def _controllers(self, given: list[Controller]) -> list[str]:
        if self.controller_port is not None:
            return [f"127.0.0.1:{self.controller_port}"]
        reached = [_reached(controller, self.name) for controller in given]
        return [f"{controller.IP()}:{controller.port}" for controller in reached]

    def stop(self, deleteIntfs: bool = True) -> None:  # noqa: N803 (Mininet's name)
        """End the agent, then take the bridge away."""
        self._end_agent()
        super().stop(deleteIntfs)

    def terminate(self) -> None:
        """End the agent, then the switch."""
        self._end_agent()
        super().terminate()

    def _end_agent(self) -> None:
        """End the agent, whose end is no fault then."""
        if self.program:
            self.network.programs.remove(self.program)
            self.program.stop()
            self.program = None
            openvswitch.remove_agent_sockets(self.name)


@dataclass(frozen=True)
class Reached:
    """A controller as one switch reaches it: what Mininet asks of a controller."""

    name: str
    address: str
    port: int
    protocol: str = "tcp"

    def IP(self) -> str:  # noqa: N802 (Mininet's name)
        """Return the address."""
        return self.address


def _reached(controller: Controller, switch: str) -> Any:
    """Return a controller as a switch reaches it: ours is on the management network."""
    if not isinstance(controller, QuantumController):
        return controller
    return Reached(controller.name, controller.addresses[switch], controller.port)


class QuantumController(QuantumNode, Controller):
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
        said: dict[str, Any] = {"controller": framework, "policy": policy, "rest": rest}
        network.settings = replace(
            network.settings,
            apps=(*network.settings.apps, *filter(None, apps.split("+"))),
            **{name: value for name, value in said.items() if value},
        )
        self.network = network
        self.addresses: dict[str, str] = {}  # on the management network, by switch
        settings = {"port": self.network.settings.openflow_port, "inNamespace": True}
        super().__init__(name, **{**params, **settings})
        self._early: EarlyStart | None = self._begin()
        self._launched = False

    def checkListening(self) -> None:  # noqa: N802 (Mininet's name)
        """Let the controller itself find out whether its port is free."""

    @property
    def program(self) -> Program | None:
        """The controller's program, if it was started."""
        return self._early.program if self._early else None

    def _begin(self) -> EarlyStart:
        """Let the controller load its framework, which takes longest of all."""
        words = ["--framework", self.network.settings.controller]
        return EarlyStart(self.network, self.name, "controller_apps", words, self)

    def launch(self) -> None:
        """Start the controller ahead of `start`, which then only has to wait."""
        if self._launched:
            return
        self._early = self._early or self._begin()
        network = self.network
        if not self.addresses:
            self.addresses = lay_management(self, network.bridges, network)
            connect_copper(network)
        config = ControllerConfig(
            listen=f"0.0.0.0:{self.port}",
            framework=network.settings.controller,
            quantum_switches=dict(network.datapath_ids),
            record=str(network.logs / RECORD),
            address=free_address(network.addresses.values(), network.prefix_length),
            device_keys=network.device_keys,
            addresses={host: network.addresses[host] for host in network.device_keys},
            stations=[station for host in network.hosts for station in stations_of(host)],
            console=network.socket(CONSOLE),
            rest_token=network.rest_token() if network.settings.rest else "",
            state=str(network.folder / STATE),
            **part(ControllerSettings, network.settings),
        )
        self._early.go_on(config)
        self._launched = True

    def IP(self, intf: object = None) -> str:  # noqa: N802 (Mininet's name)
        """Return an address on the management network, if it has one."""
        return next(iter(self.addresses.values()), str(self.ip))

    def start(self) -> None:
        """Start the controller and wait until switches can connect."""
        self.launch()
        assert self._early is not None
        self._early.program.wait_for("ready", READY_TIMEOUT_S)

    def stop(self, *_args: object, **_params: object) -> None:
        """End the controller."""
        if self._early:
            self._early.stop()
            self._early, self._launched = None, False
        self.terminate()
