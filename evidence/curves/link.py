"""Two hosts with two fibres: one that is measured, and an ideal one beside it.

    alice-q0 ====== fibre under test ====== bob-q0
    alice-q1 ====== ideal ================= bob-q1

Both are equally long, so that photons of one moment arrive at one moment.
"""

from dataclasses import asdict, replace
from typing import Any

from dispatcher.laboratory import Laboratory
from evidence.curves.parameters import Parameter, Values, of_dataclass
from topologies.catalogue.presets import PRESETS
from wire.config import DispatcherConfig
from wire.parameters.fiber import Fiber, FiberEnd, FiberOptics, optics
from wire.parameters.physics import BellAnalyser, Detectors, Device, PairSource

TESTED, PLAIN = ("alice-q0", "bob-q0"), ("alice-q1", "bob-q1")
PRESET = Parameter("preset", "ideal", choices=tuple(PRESETS))
FIBER = tuple(of_dataclass("", FiberOptics()))
PARTS: dict[str, Any] = {
    "source_": PairSource(),
    "detectors_": Detectors(),
    "analyser_": BellAnalyser(),
}
DEVICES = tuple(each for prefix, part in PARTS.items() for each in of_dataclass(prefix, part))
LINK = (PRESET, *FIBER, *DEVICES)


def implied(given: Values) -> Values:
    """Return what preset and kind of fibre say of the parameters that are not given."""
    preset = PRESETS[str(given.get(PRESET.name, PRESET.default))]
    own = {each.name: given[each.name] for each in FIBER if each.name in given}
    values = asdict(optics("the fibre", **{**preset.fiber, **own}))
    for prefix in PARTS:
        part = asdict(getattr(preset.device, prefix.rstrip("_")))
        values |= {f"{prefix}{name}": value for name, value in part.items()}
    return {each.name: each.value(values[each.name]) for each in (*FIBER, *DEVICES)}


def link(values: Values, seed: int) -> Laboratory:
    """Return a laboratory with this link; parameters that values lack are ideal."""
    parameters: dict[str, Any] = {n.name: values[n.name] for n in FIBER if n.name in values}
    tested = fiber(*TESTED, **parameters)
    plain = fiber(*PLAIN, length_km=tested.length_km)
    devices = dict.fromkeys(("alice", "bob"), device(values))
    return Laboratory(configuration(seed, [tested, plain], devices))


def is_plain(values: Values, *but: str) -> bool:
    """Return whether everything of the link is ideal, but for what is named."""
    numbers = (each for each in (*FIBER, *DEVICES) if each.name not in ("kind", *but))
    return all(values[each.name] == each.default for each in numbers)


def fiber(port: str, far_port: str, **parameters: Any) -> Fiber:
    """Return a fibre between two hosts' ports; raise BadParameter."""
    a, b = (FiberEnd(end.partition("-")[0], end) for end in (port, far_port))
    return Fiber.joining(a, b, optics(f"fibre {port} to {far_port}", **parameters))


def configuration(
    seed: int, fibers: list[Fiber], devices: dict[str, Device] | None = None
) -> DispatcherConfig:
    listed = devices or {}
    return DispatcherConfig("", "", seed, dict.fromkeys(listed, ""), fibers, [], devices=listed)


def device(values: Values) -> Device:
    parts: dict[str, Any] = {}
    for prefix, part in PARTS.items():
        own: dict[str, Any] = {
            name.removeprefix(prefix): value
            for name, value in values.items()
            if name.startswith(prefix)
        }
        parts[prefix.rstrip("_")] = replace(part, **own)
    return Device(**parts)
