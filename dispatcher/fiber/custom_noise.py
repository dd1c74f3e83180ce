"""Noise models of a user's own, from a file that the topology names: "path/to/file.py:ClassName".

The file is on this machine's disk and its path comes from whoever starts the network, as the
topology itself does; nothing that comes over the network ever names one.
"""

import importlib.util
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dispatcher.fiber.noise import Effect, NoiseModel, Passage
from wire.config import BadConfig

LARGEST_PAULI = 3


class OwnNoise:
    """A model whose answers are checked, because it is not ours."""

    def __init__(self, reference: str, model: NoiseModel) -> None:
        """Ask this model, named as the topology names it."""
        self._reference, self._model = reference, model

    def effect(self, passage: Passage) -> Effect:
        """Return its answer; raise BadConfig for one that no photons can follow."""
        effect = self._model.effect(passage)
        if not isinstance(effect, Effect):
            raise BadConfig(f"{self._reference}: effect gave {effect!r}; return an Effect")
        for name, kind in (
            ("lost", np.bool_),
            ("paulis", np.uint8),
            ("extras", np.uint8),
            ("angles_rad", np.float64),
            ("delays_ps", np.float64),
        ):
            self._check(name, getattr(effect, name), kind, passage.photons)
        if effect.paulis is not None and effect.paulis.max() > LARGEST_PAULI:
            raise BadConfig(f"{self._reference}: Pauli {effect.paulis.max()} is not 0 to 3")
        if not 0 <= effect.transmission <= 1:
            raise BadConfig(f"{self._reference}: transmission {effect.transmission} is not 0 to 1")
        return effect

    def _check(
        self, name: str, array: NDArray[Any] | None, kind: type[np.generic], photons: int
    ) -> None:
        if array is None:
            return
        fits = isinstance(array, np.ndarray) and array.shape == (photons,) and array.dtype == kind
        if not fits:
            found = f"{array.dtype} {array.shape}" if isinstance(array, np.ndarray) else repr(array)
            raise BadConfig(
                f"{self._reference}: {name} is {found}; give {kind.__name__} for {photons} photons"
            )
        if kind is np.float64 and not np.isfinite(array).all():
            raise BadConfig(f"{self._reference}: {name} holds what is not a number")


def load(reference: str, parameters: Mapping[str, Any]) -> OwnNoise:
    """Return the model that "file.py:ClassName" names, made with these keywords.

    Raise BadConfig where that does not work.
    """
    file, _, name = reference.rpartition(":")
    model_class: Any = getattr(_module(reference, Path(file)), name, None)
    if not callable(getattr(model_class, "effect", None)):
        raise BadConfig(f"noise {reference}: {file} has no class {name} with a method effect")
    try:
        return OwnNoise(reference, model_class(**parameters))
    except (TypeError, ValueError) as error:
        raise BadConfig(f"noise {reference} with {dict(parameters)}: {error}") from error


def _module(reference: str, file: Path) -> object:
    spec = importlib.util.spec_from_file_location(f"custom_noise_{file.stem}", file)
    if spec is None or spec.loader is None or not file.is_file():
        raise BadConfig(f"noise {reference}: {file} is not a Python file on this machine")
    module = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
    except (ImportError, SyntaxError, NameError, OSError) as error:
        raise BadConfig(f"noise {reference}: {file} cannot be loaded: {error}") from error
    return module
