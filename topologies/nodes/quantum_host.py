"""A host with light, and its device."""

from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from topologies.links.fiber import python_file, qnics
from topologies.links.keywords import refuse_unknown
from topologies.nodes.addresses import broadcast
from topologies.nodes.classical_host import ClassicalHost
from topologies.nodes.tls import credentials
from topologies.system.confinement.confinement import READ, WRITTEN
from topologies.system.runs import runtime
from topologies.system.runs.launching import launch
from wire.config import (
    CONTROLLER,
    LIGHT,
    STANDING,
    BadConfig,
    HostConfig,
    QuantumSwitch,
)
from wire.features import EMIT
from wire.lldp import period_s
from wire.network_time import SteppedTime
from wire.parameters.checks import check_choice
from wire.parameters.physics import (
    BadParameter,
    BellAnalyser,
    Detectors,
    Device,
    Gates,
    Memory,
    PairSource,
)
from wire.registered import HARDWARE

MOST_PAIR_RATE_HZ = 50_000_000
PARTS = ("source", "memory", "detectors", "analyser", "gates")


def device_of(name: str, params: Mapping[str, Any]) -> Device:
    """Return the device that the parameters of a QuantumHost describe; raise BadParameter."""
    device = params.get("device")
    if not isinstance(device, Device | None):
        raise BadParameter(f"{name}: device {device!r} is not a Device")
    parts = {part: params.get(part) for part in PARTS}
    settings = {
        part: value
        for part, value in parts.items()
        if value is not None and not isinstance(value, bool)
    }
    described = replace(device or Device(), **settings)
    described.check(name)
    return described


class QuantumHost(ClassicalHost):
    """A host with a QNIC: runs the three-layer stack.

    `source=True` makes pairs, for all hosts that do not name another by `pairs_from`. Its hardware
    is given by parts, as detectors=Detectors(efficiency=0.8), or as one `device`; `source` may be a
    PairSource. `light` says who grants it (wire.config.LIGHT). Raise BadParameter if a value is out
    of range. `qnic` is "" for simulated hardware, or "path/to/file.py:ClassName" of a class of
    one's own (hosts/hardware/simulated.py), which is made with `qnic_parameters`.
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
        memory_mib: int | None = None,
        **params: object,
    ) -> None:
        check_choice(f"{name}: light", light, LIGHT, BadParameter)
        parts = {"memory": memory, "detectors": detectors, "analyser": analyser, "gates": gates}
        described = device_of(name, {"source": source, "device": device, **parts})
        self.qnic = python_file(f"{name}: qnic", qnic, HARDWARE)
        self.qnic_parameters = dict(qnic_parameters or {})
        refuse_unknown(name, params, type(self))  # before a network begins
        runtime.current().devices[name] = described  # the shell knows the socket by it
        super().__init__(name, confined, memory_mib, **params)
        self.network.token(name)
        self.pairs_from = pairs_from
        self.light = light
        self.network.device_key(name)
        if source:
            self.network.source = name

    def environment(self) -> dict[str, str]:
        return {**super().environment(), "QMN_STACK": self.network.socket(self.name)}

    def shown_folders(self) -> dict[Path, str]:
        folder, keys = self.network.own_folder(self.name), Path(self.network.key_folder(self.name))
        time = self.network.time
        clock = {Path(time.folder): READ} if isinstance(time, SteppedTime) else {}
        return {folder: READ, keys: READ, **clock, self.network.written_folder(self.name): WRITTEN}

    def config(self, **params: object) -> dict[str, object]:
        result = super().config(**params)
        if self.light == STANDING:
            require_unrotated(self.network.switches.values())
        self.program = launch(self.network, self.name, "hosts", self.stack_config(), self)
        return result

    def stack_config(self) -> HostConfig:
        """Return the configuration of the stack; all nodes and fibres are made by now."""
        network, device = self.network, self.network.devices[self.name]
        return HostConfig(
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
            analyser=device.analyser.kind,
            qnic=self.qnic,
            qnic_parameters=self.qnic_parameters,
            features=device.features.value,
            memory_qubits=device.memory.capacity,
            multi_photon=device.source.multi_photon,
            intensities=list(device.source.intensities),
            pair_secrets=network.secrets_folder(),
            pair_rate_hz=pair_rate_hz(network.devices.values()),
            t1_s=device.memory.t1_s,
            t2_s=device.memory.t2_s,
            depolarizing_s=device.memory.depolarizing_s,
            cutoff_s=device.memory.cutoff_s,
            compensates=device.compensator.retarders > 0,
            keys=network.key_folder(self.name),
            light=self.light,
            announcement_period_s=period_s(len(network.fibers)),
            channels_mhz={
                end.port: fiber.fixed_mhz
                for fiber in network.fibers
                for end in (fiber.a, fiber.b)
                if end.node == self.name and fiber.fixed_mhz is not None
            },
            credentials=credentials(network, self.name) if network.tls else None,
        )


def pair_rate_hz(devices: Iterable[Device]) -> int:
    """Return the rate at which every source of a network can make pairs."""
    rates = [device.source.max_rate_hz for device in devices if EMIT in device.features]
    return max(1, int(min([MOST_PAIR_RATE_HZ, *rates])))


def require_unrotated(switches: Iterable[QuantumSwitch]) -> None:
    """Raise BadConfig for a switch that rotates light: only our controller tells hosts of it."""
    for switch in switches:
        if switch.rotation or any(path.rotation for path in switch.paths):
            raise BadConfig(
                f"{switch.name} rotates light, of which light=standing does not inform hosts; "
                "take rotation=0 or light=controller"
            )
