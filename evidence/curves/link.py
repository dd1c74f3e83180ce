"""Two hosts with two fibres: one that is measured, and an ideal one beside it.

    alice-q0 ====== fibre under test ====== bob-q0
    alice-q1 ====== ideal ================= bob-q1

Both are equally long, so that photons of one moment arrive at one moment.
"""

from collections.abc import Awaitable, Callable, Iterator, Sequence
from dataclasses import asdict, replace
from typing import Any

import numpy as np

from dispatcher.sabot.backend import Bytes
from evidence.curves.estimates import Estimate, proportion
from evidence.curves.parameters import Parameter, Values, of_dataclass
from evidence.laboratory import BlockKey, Laboratory, LaboratoryHost
from topologies.catalogue.presets import PRESETS
from wire.config import DispatcherConfig
from wire.dispatcher_pb2 import MeasureRequest
from wire.parameters.fiber import Fiber, FiberEnd, FiberOptics, optics
from wire.parameters.physics import BellAnalyser, Detectors, Device, PairSource

Ports = tuple[str, str]  # the ports of a fibre
Ends = Sequence[tuple[LaboratoryHost, BlockKey]]

TESTED, PLAIN = ("alice-q0", "bob-q0"), ("alice-q1", "bob-q1")
BLOCK_PAIRS = 65_536
MIN_BLOCK_PAIRS = 1_024
BATCHES = 64  # that the error of a ratio is estimated from, if there are as many
BASES = (MeasureRequest.X, MeasureRequest.Y, MeasureRequest.Z)
PRESET = Parameter("preset", "ideal", choices=tuple(PRESETS))
FIBER = tuple(of_dataclass("", FiberOptics()))
PARTS: dict[str, Any] = {
    "source_": PairSource(),
    "detectors_": Detectors(),
    "analyser_": BellAnalyser(),
}
DEVICES = tuple(each for prefix, part in PARTS.items() for each in of_dataclass(prefix, part))
LINK = (PRESET, *FIBER, *DEVICES)


def implied(values_given: Values) -> Values:
    """Return what preset and kind of fibre say of the parameters that are not given."""
    preset = PRESETS[str(values_given.get(PRESET.name, PRESET.default))]
    values = asdict(optics("the fibre", **{**preset.fiber, **optics_of(values_given)}))
    for prefix in PARTS:
        part = asdict(getattr(preset.device, prefix.rstrip("_")))
        values |= {f"{prefix}{name}": value for name, value in part.items()}
    return {each.name: each.value(values[each.name]) for each in (*FIBER, *DEVICES)}


def link(values: Values, seed: int) -> Laboratory:
    """Return a laboratory with this link; parameters that values lack are ideal."""
    tested = fiber(*TESTED, **optics_of(values))
    plain = fiber(*PLAIN, length_km=tested.length_km)
    end = device(values)
    return network(seed, [tested, plain], alice=end, bob=end)


def optics_of(values: Values) -> dict[str, Any]:
    return {setting.name: values[setting.name] for setting in FIBER if setting.name in values}


def is_plain(values: Values, *but: str) -> bool:
    """Return whether everything of the link is ideal, but for what is named."""
    numbers = (each for each in (*FIBER, *DEVICES) if each.name not in ("kind", *but))
    return all(values[number.name] == number.default for number in numbers)


def fiber(port: str, far_port: str, **parameters: Any) -> Fiber:
    """Return a fibre between two hosts' ports; raise BadParameter."""
    a, b = (FiberEnd(end.partition("-")[0], end) for end in (port, far_port))
    return Fiber.joining(a, b, optics(f"fibre {port} to {far_port}", **parameters))


def configuration(
    seed: int, fibers: list[Fiber], devices: dict[str, Device] | None = None
) -> DispatcherConfig:
    listed = devices or {}
    return DispatcherConfig("", "", seed, dict.fromkeys(listed, ""), fibers, [], devices=listed)


def network(seed: int, fibers: list[Fiber], **devices: Device) -> Laboratory:
    return Laboratory(configuration(seed, fibers, devices))


def device(values: Values) -> Device:
    parts: dict[str, Any] = {}
    for prefix, part in PARTS.items():
        settings: dict[str, Any] = {
            name.removeprefix(prefix): value
            for name, value in values.items()
            if name.startswith(prefix)
        }
        parts[prefix.rstrip("_")] = replace(part, **settings)
    return Device(**parts)


def blocks(pairs: float) -> Iterator[tuple[int, int]]:
    """Yield number and size of equal blocks that make up a number of pairs, or a few less."""
    pairs = int(pairs)
    size = min(max(pairs // BATCHES, MIN_BLOCK_PAIRS), BLOCK_PAIRS, pairs)
    yield from ((number, size) for number in range(pairs // size))


async def share(
    giver: LaboratoryHost, taker: LaboratoryHost, pairs: int, block: int, ports: Ports = TESTED
) -> None:
    """Make pairs, and send half 1 of each to the other host."""
    await giver.create(pairs, block)
    await giver.send({(block, 1): ports[0]})
    await taker.receive((block, 1), ports[1])


async def measured(
    ends: Ends, basis: MeasureRequest.Basis = MeasureRequest.Z, bases: Bytes | None = None
) -> list[Bytes]:
    return [await host.measure(block, basis, bases) for host, block in ends]


async def fidelity(ends_of: Callable[[int], Awaitable[Ends]]) -> Estimate:
    """Return F = (1 + <XX> - <YY> + <ZZ>)/4 of pairs, a block of which is made for each basis."""
    agreeing = []
    for turn, basis in enumerate(BASES):
        mine, yours = await measured(await ends_of(turn), basis)
        # In the Y basis the halves of Phi+ disagree.
        right = (mine ^ yours) == (basis == MeasureRequest.Y)
        agreeing.append(proportion(int(np.count_nonzero(right)), mine.size))
    value = (1 + sum(2 * each.value - 1 for each in agreeing)) / 4
    return Estimate(value, sum(each.error**2 for each in agreeing) ** 0.5 / 2)
