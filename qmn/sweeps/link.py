"""Two hosts with two fibres: one that is measured, and an ideal one beside it.

    alice-q0 ====== fibre under test ====== bob-q0
    alice-q1 ====== ideal ================= bob-q1

Both are equally long, so that photons of one moment arrive at one moment.
"""

from dataclasses import replace
from typing import Any

from dispatcher.laboratory import Laboratory
from qmn.sweeps.parameters import BadGrid, Parameter, Values, of_dataclass
from topologies.presets import PRESETS
from wire.config import DispatcherConfig
from wire.fiber import Fiber, FiberEnd, FiberOptics, optics
from wire.physics import BadParameter, BellAnalyser, Detectors, Device, PairSource

TESTED, PLAIN = ("alice-q0", "bob-q0"), ("alice-q1", "bob-q1")
PRESET = Parameter("preset", "ideal", choices=tuple(PRESETS))
FIBER = tuple(of_dataclass("", FiberOptics()))
PARTS = {"source_": PairSource(), "detectors_": Detectors(), "analyser_": BellAnalyser()}
DEVICES = tuple(each for prefix, part in PARTS.items() for each in of_dataclass(prefix, part))
LINK = (PRESET, *FIBER, *DEVICES)


def link(values: Values, seed: int) -> Laboratory:
    """Return a laboratory with this link; raise BadGrid for one that cannot be.

    What is at its default, or not in the values, is as the preset and the kind of fibre have it.
    """
    try:
        tested = fiber(*TESTED, **fiber_parameters(values))
        plain = fiber(*PLAIN, length_km=tested.length_km)
        own = device(values)
        own.check("device")
    except BadParameter as error:
        raise BadGrid(str(error)) from error
    return Laboratory(configuration(seed, [tested, plain], dict.fromkeys(("alice", "bob"), own)))


def is_plain(values: Values, *but: str) -> bool:
    """Return whether everything of the link is at its default, but for what is named."""
    return all(values[each.name] == each.default for each in LINK if each.name not in but)


def fiber(port: str, far_port: str, **parameters: Any) -> Fiber:
    """Return a fibre between two hosts' ports; raise BadParameter."""
    a, b = (FiberEnd(end.partition("-")[0], end) for end in (port, far_port))
    return Fiber.joining(a, b, optics(f"fibre {port} to {far_port}", **parameters))


def configuration(
    seed: int, fibers: list[Fiber], devices: dict[str, Device] | None = None
) -> DispatcherConfig:
    """Return a network without sockets."""
    listed = devices or {}
    return DispatcherConfig("", "", seed, dict.fromkeys(listed, ""), fibers, [], devices=listed)


def fiber_parameters(values: Values) -> dict[str, Any]:
    """Return what differs from an ideal fibre."""
    preset = PRESETS[str(values.get(PRESET.name, PRESET.default))]
    return {**preset.fiber, **changed(values, "", FIBER)}


def device(values: Values) -> Device:
    """Return the device of the preset with what differs from it."""
    preset = PRESETS[str(values.get(PRESET.name, PRESET.default))].device
    parts: dict[str, Any] = {
        prefix.rstrip("_"): replace(
            getattr(preset, prefix.rstrip("_")), **changed(values, prefix, DEVICES)
        )
        for prefix in PARTS
    }
    return replace(preset, **parts)


def changed(values: Values, prefix: str, parameters: tuple[Parameter, ...]) -> dict[str, Any]:
    """Return the values that are not at their default, of parameters with this prefix."""
    return {
        each.name.removeprefix(prefix): values[each.name]
        for each in parameters
        if each.name.startswith(prefix) and values.get(each.name, each.default) != each.default
    }
