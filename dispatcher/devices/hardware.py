"""The quantum hardware of the hosts: what it is like, and refusals of what it cannot do."""

from collections.abc import Collection, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dispatcher.devices.detectors import DetectorPair
from dispatcher.fiber import custom_noise
from dispatcher.fiber.noise import Effect, NoiseHistory, Passage, Pattern, Schedule
from dispatcher.photon_random import Source
from dispatcher.refusal import invalid, not_found, precondition
from wire.config import BadConfig
from wire.features import ABSORB, EMIT, GATE, HERALD, INTERFERE, MEASURE, STORE, Feature
from wire.parameters.physics import BadParameter, Device

DEPTH = 1000  # values that a model remembers
OF_PARTS = {"lost", "paulis", "kraus", "exact", "named"}
OF_FIBERS = Effect()._asdict().keys() - OF_PARTS


class Moment(Passage):
    """The input of a model: k qubits of a block that something happens to at one time.

    `what` is "source" (pairs or photons that are made), "memory" (qubits that have waited for so
    long, `waited_s` of shape (k,)), "gate" (on this number of `qubits`) or "detectors" (their
    outcomes). It has also what a passage has: `photons` is k, `history` the memory of the model
    here.
    """

    def __init__(
        self,
        draws: Source,
        block: tuple[int, int, int],
        place: str,
        schedule: Schedule,
        history: NoiseHistory,
        what: str,
        waited_s: NDArray[np.float64],
        qubits: int,
    ) -> None:
        super().__init__(draws, block, place, schedule, history)
        self.what, self.waited_s, self.qubits = what, waited_s, qubits


class PartNoise:
    """A model with what it remembers, of one part of one host."""

    def __init__(self, reference: str, parameters: Mapping[str, Any]) -> None:
        """Load it; raise BadConfig where that does not work."""
        self._reference = reference
        self._model = custom_noise.load(reference, parameters)
        self._history = NoiseHistory(DEPTH)

    def effect(
        self,
        draws: Source,
        block: tuple[int, int, int],
        what: str,
        place: str,
        time_ns: int,
        waited_s: NDArray[np.float64],
        qubits: int = 1,
    ) -> Effect:
        """Return what happens to the qubits of a block now; BadConfig for what cannot."""
        schedule = Schedule(time_ns, Pattern(0.0, waited_s.size))
        place = f"own {what}, {place}"
        moment = Moment(draws, block, place, schedule, self._history, what, waited_s, qubits)
        effect = self._model.effect(moment)
        for name in OF_FIBERS:
            array = getattr(effect, name)
            if array is not None and not (name == "transmission" and array == 1):
                raise BadConfig(
                    f"{self._reference}: {name} is of fibres; give lost, paulis and kraus"
                )
        return effect


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
        """Raise BadParameter for a value out of range, BadConfig for bad noise models."""
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

    def adjust_memories(self, nodes: Collection[str], settings: Mapping[str, Any]) -> None:
        """Change settings of memories from now on; refuse bad values, and change nothing."""
        changed = {}
        for node in nodes:
            if node not in self._listed:
                raise not_found(f"{node} has no memory: name a host, or a switch with memories")
            device = self._listed[node]
            changed[node] = replace(device, memory=replace(device.memory, **settings))
            try:
                changed[node].check(node)
            except BadParameter as error:
                raise invalid(str(error)) from error
        self._listed |= changed

    def noise(self, node: str, part: str) -> PartNoise | None:
        return self._noises.get((node, part))

    def detectors(self, node: str, arm: str) -> DetectorPair:
        """Return the two detectors in one arm of a host's set-up, always the same two."""
        if (node, arm) not in self._detectors:
            self._detectors[node, arm] = DetectorPair(self.of(node).detectors)
        return self._detectors[node, arm]


def require(devices: Devices, node: str, *any_of: Feature) -> None:
    features = devices.of(node).features
    if not any(each in features for each in any_of):
        names = " or ".join(str(each.name) for each in any_of)
        raise precondition(f"feature {names} is needed: {node} {WANTING[any_of[0]]}")


def require_encoding(devices: Devices, node: str, encoding: str) -> None:
    measured = devices.of(node).detectors.encoding
    if encoding != measured:
        raise precondition(
            f"{node} measures {measured} qubits, and these are {encoding} qubits: let its "
            "detectors.encoding be that of the source.encoding"
        )
