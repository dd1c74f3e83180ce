"""The quantum hardware of the hosts: what it is like, and refusals of what it cannot do."""

from collections.abc import Mapping

from dispatcher.devices.detectors import DetectorPair
from dispatcher.devices.part_noise import PartNoise
from dispatcher.refusal import precondition
from wire.features import ABSORB, EMIT, GATE, HERALD, INTERFERE, MEASURE, STORE, Feature
from wire.parameters.physics import Device

IDEAL = Device()
WANTING = {
    EMIT: "has no source of light: let another host make it",
    ABSORB: "has a memory that emits and takes in no light from elsewhere (memory.kind emissive): "
    "use the light as it comes, let a station herald pairs, or give it one of kind absorptive",
    STORE: "has no memory: use the light as it comes, or give it a memory.capacity",
    GATE: "does Pauli operators alone (gates.kind paulis): send Paulis, or give it other gates",
    MEASURE: "has no detectors that click: let another host measure",
    HERALD: "has no qubits that emit: give it an emitter.scheme",
    INTERFERE: "has no analyser in which light interferes: give it one (analyser.kind linear), or "
    "detectors that click",
}


class Devices:
    """The devices of all hosts; a host that is not listed has ideal ones."""

    def __init__(self, listed: Mapping[str, Device]) -> None:
        """Have these; raise BadParameter for what no device is like, BadConfig for its noise."""
        for host, device in listed.items():
            device.check(host)
        self._listed = dict(listed)
        self._detectors: dict[tuple[str, str], DetectorPair] = {}
        self._noises = {
            (host, part): PartNoise(*noise)
            for host, device in listed.items()
            for part, noise in device.noises.items()
        }

    def of(self, node: str) -> Device:
        return self._listed.get(node, IDEAL)

    def noise(self, node: str, part: str) -> PartNoise | None:
        return self._noises.get((node, part))

    def detectors(self, node: str, arm: str) -> DetectorPair:
        """Return the two detectors in one arm of a host's set-up, always the same two."""
        if (node, arm) not in self._detectors:
            self._detectors[node, arm] = DetectorPair(self.of(node).detectors)
        return self._detectors[node, arm]


def require(devices: Devices, node: str, *any_of: Feature) -> None:
    """Refuse unless the device of a node has one of these features."""
    features = devices.of(node).features
    if not any(each in features for each in any_of):
        wanted = " or ".join(str(each.name) for each in any_of)
        raise precondition(f"feature {wanted} is needed: {node} {WANTING[any_of[0]]}")


def require_encoding(devices: Devices, node: str, encoding: str) -> None:
    """Refuse unless the detectors of a node tell qubits of this encoding."""
    own = devices.of(node).detectors.encoding
    if own != encoding:
        raise precondition(
            f"{node} measures {own} qubits, and these are {encoding} qubits: let its "
            "detectors.encoding be that of the source.encoding"
        )
