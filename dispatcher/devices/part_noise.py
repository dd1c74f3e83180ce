"""Noise models of a user's own for parts of devices: sources, memories, gates and detectors."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dispatcher.fiber import custom_noise
from dispatcher.fiber.noise import Effect, Passage, Pattern, Schedule
from dispatcher.fiber.noise_history import NoiseHistory
from dispatcher.photon_random import Source
from wire.config import BadConfig

DEPTH = 1000  # values that a model remembers
OF_PARTS = {"lost", "paulis", "kraus", "exact", "named"}
OF_FIBERS = Effect()._asdict().keys() - OF_PARTS


class Moment(Passage):
    """What a model is told: k qubits of a block, at one time, that something happens to.

    `what` is "source" (pairs or photons that are made), "memory" (qubits that have waited for so
    long, `waited_s` of shape (k,)), "gate" (of so many `qubits`) or "detectors" (what they tell).
    Beside that all that a passage has: `photons` is k, `history` what the model remembered here.
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
        """Draw from a block's generators for one such moment."""
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
            given = getattr(effect, name)
            if given is not None and not (name == "transmission" and given == 1):
                raise BadConfig(
                    f"{self._reference}: {name} is of fibres; give lost, paulis and kraus"
                )
        return effect
