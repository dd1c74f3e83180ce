"""The state of a quantum switch in the words of OpenConfig.

| model (its YANG module) | what of it |
|---|---|
| openconfig-interfaces | name, oper-status; photons as in-pkts, out-pkts, in-discards (lost ones) |
| openconfig-platform | components: the switch with its temperature, ports |
| openconfig-transport-line-common | optical-port: input-power, output-power (dBm) |
| openconfig-platform-transceiver | physical-channel 0: laser-bias-current (mA), output-frequency |
| openconfig-wavelength-router | media-channels: the light paths that stand, by their circuits |
| qmn-light (qmn-light.yang, here) | of a media channel: insertion-loss, photons |

Of all of them state alone, and of state the leaves that are here. Quantities that are not measured
are absent.

Paths and values of telemetry as gNMI has them: leaves of a tree, found by paths with wildcards.

gNMI specification 0.8, sections 2.2.2 (paths) and 2.3 (values); gNMI path conventions (wildcards).
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from qswitch_agent.hardware.optics import CrossConnect, PortReading, Readings
from wire.optical import (
    ANY_PORT,
    VALID_RX_PWR,
    VALID_TX_BIAS,
    VALID_TX_PWR,
    VALID_TX_TEMP,
    VALID_TX_TUNE,
    PathOptics,
    PortLight,
)

ANY, ANY_MANY = "*", "..."


class Element(NamedTuple):
    """One step of a path: a node's name, and the keys of an entry of a list."""

    name: str
    keys: tuple[tuple[str, str], ...] = ()

    def matches(self, other: "Element") -> bool:
        """Tell whether another step, without wildcards, is one that this names.

        Modules before a name (`openconfig-platform:components`) may be absent; a key that is
        absent stands for all.
        """
        if self.name != ANY and self.name.rpartition(":")[2] != other.name.rpartition(":")[2]:
            return False
        values = dict(other.keys)
        return all(value == ANY or values.get(key) == value for key, value in self.keys)


Path = tuple[Element, ...]


class Large(int):
    """A number of 64 bits, which JSON of the IETF writes as a string (RFC 7951, 6.1)."""


Value = str | int | float


class Leaf(NamedTuple):
    path: Path
    value: Value


def found(leaves: Sequence[Leaf], path: Path) -> list[Leaf]:
    return [leaf for leaf in leaves if _is_below(leaf.path, path)]


def _is_below(place: Path, path: Path) -> bool:
    if not path:
        return True
    first, rest = path[0], path[1:]
    if first.name == ANY_MANY:
        return any(_is_below(place[start:], rest) for start in range(len(place) + 1))
    return bool(place) and first.matches(place[0]) and _is_below(place[1:], rest)


OPEN_CONFIG = "OpenConfig working group"


class Model(NamedTuple):
    """A YANG module as gNMI's Capabilities name it."""

    name: str
    organization: str
    version: str  # of OpenConfig's modules openconfig-version, of others their revision


# Versions are those of github.com/openconfig/public at 94f58962; the leaves here are in them.
MODELS = (
    Model("openconfig-interfaces", OPEN_CONFIG, "3.8.1"),
    Model("openconfig-platform", OPEN_CONFIG, "0.32.0"),
    Model("openconfig-platform-transceiver", OPEN_CONFIG, "1.0.0"),
    Model("openconfig-transport-line-common", OPEN_CONFIG, "0.6.0"),
    Model("openconfig-wavelength-router", OPEN_CONFIG, "1.2.0"),
    Model("qmn-light", "qmn", "2026-11-22"),
)
UP, DOWN = "UP", "DOWN"
PORT_TYPE = "openconfig-platform-types:PORT"
CHASSIS_TYPE = "openconfig-platform-types:CHASSIS"
LOSS, PHOTONS = "qmn-light:insertion-loss", "qmn-light:photons"


@dataclass(frozen=True)
class Fiber:
    """A fibre's port at one moment."""

    name: str
    whole: bool
    light: PortLight


@dataclass(frozen=True)
class Observed:
    name: str
    fibers: Mapping[int, Fiber]  # by OpenFlow port number
    readings: Readings
    standing: Iterable[CrossConnect]
    optics: Iterable[PathOptics]


def leaves(seen: Observed) -> list[Leaf]:
    return [*_chassis(seen), *_fibers(seen), *_channels(seen)]


def _chassis(seen: Observed) -> Iterator[Leaf]:
    at = (Element("components"), Element("component", (("name", seen.name),)), Element("state"))
    yield _leaf(at, "name", seen.name)
    yield _leaf(at, "type", CHASSIS_TYPE)
    lights = [fiber.light for fiber in seen.fibers.values()]
    if any(light.flags & VALID_TX_TEMP for light in lights):
        yield _leaf((*at, Element("temperature")), "instant", seen.readings.temperature_c)


def _fibers(seen: Observed) -> Iterator[Leaf]:
    for number, fiber in sorted(seen.fibers.items()):
        reading = seen.readings.ports.get(number, PortReading())
        yield from _interface(fiber, reading, seen.readings.counts_photons)
        yield from _component(fiber)


def _interface(fiber: Fiber, reading: PortReading, counts: bool) -> Iterator[Leaf]:
    at = (Element("interfaces"), Element("interface", (("name", fiber.name),)), Element("state"))
    yield _leaf(at, "name", fiber.name)
    yield _leaf(at, "oper-status", UP if fiber.whole else DOWN)
    if counts:
        counters = (*at, Element("counters"))
        yield _leaf(counters, "in-pkts", Large(reading.photons_in))
        yield _leaf(counters, "out-pkts", Large(reading.photons_out))
        yield _leaf(counters, "in-discards", Large(reading.photons_lost))


def _component(fiber: Fiber) -> Iterator[Leaf]:
    at = (Element("components"), Element("component", (("name", fiber.name),)))
    yield _leaf((*at, Element("state")), "name", fiber.name)
    yield _leaf((*at, Element("state")), "type", PORT_TYPE)
    light = fiber.light
    port = (*at, Element("port"), Element("optical-port"), Element("state"))
    if light.flags & VALID_RX_PWR:
        yield _leaf((*port, Element("input-power")), "instant", light.rx_power / 10)
    if light.flags & VALID_TX_PWR:
        yield _leaf((*port, Element("output-power")), "instant", light.tx_power / 10)
    channel = Element("channel", (("index", "0"),))
    laser = (*at, Element("transceiver"), Element("physical-channels"), channel, Element("state"))
    if light.flags & VALID_TX_BIAS:
        yield _leaf((*laser, Element("laser-bias-current")), "instant", light.bias_current / 10)
    if light.flags & VALID_TX_TUNE:
        yield _leaf(laser, "output-frequency", Large(light.tx_mhz))


def _channels(seen: Observed) -> Iterator[Leaf]:
    losses = {(each.in_port, each.out_port): each.loss_mdb / 1000 for each in seen.optics}
    others = losses.get((ANY_PORT, ANY_PORT))
    for path in sorted(seen.standing):
        channel = Element("channel", (("index", str(path.circuit)),))
        at = (Element("wavelength-router"), Element("media-channels"), channel)
        state, ends = (*at, Element("state")), (path.in_port, path.out_port)
        names = [seen.fibers[port].name for port in ends]
        yield _leaf(state, "index", path.circuit)
        yield _leaf(state, "name", f"{names[0]} to {names[1]}")
        yield _leaf(state, "oper-status", UP)
        for end, name in zip(("source", "dest"), names, strict=True):
            yield _leaf((*at, Element(end), Element("state")), "port-name", name)
        if (loss_db := losses.get(ends, others)) is not None:
            yield _leaf(state, LOSS, loss_db)
        if seen.readings.counts_photons and path.circuit in seen.readings.circuits:
            yield _leaf(state, PHOTONS, Large(seen.readings.circuits[path.circuit].photons))


def _leaf(at: Path, name: str, value: Value) -> Leaf:
    return Leaf((*at, Element(name)), value)
