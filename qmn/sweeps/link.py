"""Two hosts with two fibres: one that is measured, and one without noise beside it.

    alice-q0 ====== fibre under test ====== bob-q0
    alice-q1 ====== no noise ============== bob-q1

Both are equally long, so that photons of one moment arrive at one moment.
"""

from dataclasses import replace
from typing import Any

from dispatcher.laboratory import Laboratory
from qmn.sweeps.parameters import Parameter, Values, of_dataclass
from wire.config import DispatcherConfig, Fiber, FiberEnd
from wire.physics import BellAnalyser, Detectors, Device, PairSource

TESTED, PLAIN = ("alice-q0", "bob-q0"), ("alice-q1", "bob-q1")
LENGTH_KM = 0.01
LENGTH = Parameter("length_km", LENGTH_KM, 0.0, 2_000.0, "km")
LOSS = Parameter("loss_db_per_km", 0.0, 0.0, 1_000.0, "dB/km")
DEPOLARIZING = Parameter("depolarizing", 0.0)
NOISE = (DEPOLARIZING, LOSS)
PARTS = {"source_": PairSource(), "detectors_": Detectors(), "analyser_": BellAnalyser()}
DEVICES = tuple(each for prefix, part in PARTS.items() for each in of_dataclass(prefix, part))
LINK = (DEPOLARIZING, LENGTH, LOSS, *DEVICES)


def link(values: Values, seed: int) -> Laboratory:
    """Return a laboratory with this link; parameters that values lack are at their defaults."""
    length_km = float(values.get("length_km", LENGTH_KM))
    noise: dict[str, Any] = {each.name: values.get(each.name, each.default) for each in NOISE}
    fibers = [fiber(*TESTED, length_km=length_km, **noise), fiber(*PLAIN, length_km=length_km)]
    return Laboratory(configuration(seed, fibers, dict.fromkeys(("alice", "bob"), device(values))))


def is_plain(values: Values, *but: str) -> bool:
    """Return whether everything of the link is at its default, but for what is named."""
    return all(values[each.name] == each.default for each in LINK if each.name not in but)


def fiber(port: str, far_port: str, **parameters: Any) -> Fiber:
    """Return a fibre between two hosts' ports."""
    a, b = (FiberEnd(end.partition("-")[0], end) for end in (port, far_port))
    return Fiber(a, b, **parameters)


def configuration(
    seed: int, fibers: list[Fiber], devices: dict[str, Device] | None = None
) -> DispatcherConfig:
    """Return a network without sockets."""
    return DispatcherConfig("", "", seed, {}, fibers, [], devices=devices or {})


def device(values: Values) -> Device:
    """Return the device that the parameters of its parts describe."""
    parts = {}
    for prefix, part in PARTS.items():
        own = {k.removeprefix(prefix): v for k, v in values.items() if k.startswith(prefix)}
        parts[prefix.rstrip("_")] = replace(part, **own)  # type: ignore[type-var]
    return Device(**parts)  # type: ignore[arg-type]
