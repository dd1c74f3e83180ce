"""Noise models of a user's own, from a file that the topology names: "dir/file.py:ClassName"."""

import logging
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dispatcher.approximations import Approximations
from dispatcher.fiber.noise import Effect, NoiseModel, Passage, PatternOfAll
from dispatcher.sabot.kraus import Operators, wrong_with
from programs.custom_class import fault_in, load_class
from wire.config import BadConfig

LARGEST_PAULI = 3
EACH_ITS_OWN = 4  # dimensions of Kraus operators
log = logging.getLogger(__name__)


class OwnNoise:
    """A model whose answers are checked, because it is not ours."""

    def __init__(self, reference: str, model: NoiseModel) -> None:
        self._reference, self._model = reference, model

    def effect(self, passage: Passage) -> Effect:
        """Return its answer; raise BadConfig for none, or one that no photons can follow."""
        try:
            effect = self._model.effect(passage)
        except Exception as error:  # it is another's program, which may raise any
            file = Path(self._reference.rpartition(":")[0])
            fault = fault_in(file, error)
            text = f"{self._reference}: effect raised, at {fault}"
            log.error("%s", text, exc_info=error)  # for who writes it: the whole traceback
            text += "; its traceback is in the log (of a network: dispatcher.log)"
            raise BadConfig(text) from error
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
        if not effect.exact:
            self._check_sizes(effect)
        if effect.kraus is not None:
            return effect._replace(kraus=self._channel(effect.kraus, passage.photons))
        return effect

    def _check_sizes(self, effect: Effect) -> None:
        """Refuse what says that it is not exact, and not by how much."""
        named = effect.named
        sizes = dict(named.sizes) if isinstance(named, Approximations) else None
        if not sizes or not all(fits(size) for size in sizes.values()):
            raise BadConfig(
                f"{self._reference}: exact is False, and of what is named is {sizes or named!r}; "
                'give named=approximation("what it is", 0.01) of dispatcher.approximations: the '
                "most by which the probability of an outcome can be wrong, 0 to 1"
            )

    def _channel(self, value: ArrayLike, photons: int) -> Operators:
        try:
            operators = np.asarray(value, dtype=np.complex128)
        except (TypeError, ValueError) as error:
            raise BadConfig(f"{self._reference}: Kraus operators {value!r}: {error}") from error
        if (wrong := wrong_with(operators, photons)) is not None:
            raise BadConfig(f"{self._reference}: Kraus operators: {wrong}")
        return operators

    def _check(
        self, name: str, array: NDArray[Any] | None, kind: type[np.generic], photons: int
    ) -> None:
        if array is None:
            return
        fits = isinstance(array, np.ndarray) and array.shape == (photons,) and array.dtype == kind
        if not fits:
            is_array = isinstance(array, np.ndarray)
            text = f"{array.dtype} {array.shape}" if is_array else repr(array)
            raise BadConfig(
                f"{self._reference}: {name} is {text}; give {kind.__name__} for {photons} photons"
            )
        if kind is np.float64 and not np.isfinite(array).all():
            raise BadConfig(f"{self._reference}: {name} holds what is not a number")


def of_all(
    model: OwnNoise, passage: Passage, extra_pairs: NDArray[np.int64]
) -> tuple[Effect, Effect]:
    """Return what a model does to the own photons of pulses, and to further ones of such pulses.

    It is asked once, of all photons in the order of time. Effects on a pulse, such as its delay,
    is that of its own photon.
    """
    count = passage.photons + extra_pairs.size
    pattern = PatternOfAll(passage.schedule.interval_ns, count, extra_pairs)
    effect, own, rest = (
        model.effect(passage.of_all(pattern)),
        pattern.of_own,
        pattern.of_extra_pairs,
    )
    kraus = effect.kraus
    if kraus is not None and kraus.ndim == EACH_ITS_OWN:
        kraus = kraus[np.concatenate([own, rest])]
    arrays = ("lost", "paulis", "angles_rad", "delays_ps", "extras")
    arrays_of = {name: array for name in arrays if (array := getattr(effect, name)) is not None}
    of_own = effect._replace(kraus=kraus, **{name: array[own] for name, array in arrays_of.items()})
    each = {name: arrays_of[name][rest] for name in ("lost", "paulis") if name in arrays_of}
    return of_own, Effect(**each)


def fits(size: object) -> bool:
    """Return whether a probability can be wrong by this."""
    return isinstance(size, int | float | np.floating) and bool(0 <= size <= 1)


def load(reference: str, parameters: Mapping[str, Any]) -> OwnNoise:
    """Return the model that "file.py:ClassName" names, made with these keywords.

    Raise BadConfig where that does not work.
    """
    kind = load_class("noise", reference, "with a method effect", _has_effect)
    try:
        return OwnNoise(reference, kind(**parameters))
    except (TypeError, ValueError) as error:
        raise BadConfig(f"noise {reference} with {dict(parameters)}: {error}") from error


def _has_effect(kind: type[Any]) -> bool:
    return callable(getattr(kind, "effect", None))
