"""Options of single parts on the command line, and how a topology takes them when it is built.

--fiber q1-q2.length_km=40 --switch q1.insertion_loss_db=1.2
--node ion-trap --node bob=photonic --device bob.detectors.efficiency=0.8
"""

import json
from collections import defaultdict
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from fnmatch import fnmatchcase
from functools import cached_property
from typing import Any

from qmn.network.custom_topology import BadTopology
from topologies.catalogue.node_kinds import NODE_KINDS, node_device, switch_parts
from topologies.description.content import Content, Info
from topologies.links.fiber import OPTICS as FIBER_OPTICS
from topologies.links.fiber import resolved
from topologies.nodes import OpticalSwitch, QuantumHost
from topologies.nodes.quantum_host import PARTS as DEVICE_PARTS
from topologies.nodes.quantum_host import device_of
from wire.parameters.checks import check_choice, check_names
from wire.parameters.fiber import KINDS, FiberOptics, optics
from wire.parameters.option import unit_of
from wire.parameters.physics import Device
from wire.parameters.quantity import quantity
from wire.parameters.switch import COMPOUND, QuantumSwitch
from wire.parameters.switch import OPTICS as SWITCH_OPTICS
from wire.registered import NOISE, registered

FIBER = {each.name: getattr(FiberOptics(), each.name) for each in fields(FiberOptics)}
SWITCH = {
    each.name: getattr(QuantumSwitch(""), each.name)
    for each in fields(QuantumSwitch)
    if each.name in SWITCH_OPTICS - COMPOUND
} | {"preset": "", "parts": ""}
SWITCH_PARTS = sorted(COMPOUND - {"paths"})
SWITCH |= {
    f"{part}.{name}": value
    for part in SWITCH_PARTS
    for name, value in vars(getattr(QuantumSwitch(""), part)).items()
}

IDEAL = asdict(Device())
KIND_OF = {"fiber": "fibre", "switch": "quantum switch"}  # what an option is of


@dataclass(frozen=True)
class PartOptions:
    """Settings of single fibres, switches and hosts; the words of the command line."""

    fiber: Sequence[str] = ()  # [A-B.]NAME=VALUE; without a place: of every fibre
    switch: Sequence[str] = ()  # [NAME.]NAME=VALUE; without a place: of every quantum switch
    node: Sequence[str] = ()  # HOST=KIND; without a host: of all
    device: Sequence[str] = ()  # HOST.PART.NAME=VALUE
    preset: Device = field(default_factory=Device)  # that kinds of nodes are made of

    def is_of_all(self, word: str) -> bool:
        if word in self.node:
            return "=" not in word
        return word in self.fiber and "." not in word.partition("=")[0]

    def of_every_fiber(self) -> dict[str, Any]:
        """Return the settings of all fibres; raise BadTopology for no such parameter."""
        return {name: value for _word, place, name, value in self._fibers if not place}

    @cached_property
    def _fibers(self) -> list[tuple[str, str, str, Any]]:
        return list(_said("fiber", self.fiber, FIBER))

    @property
    def named_hosts(self) -> list[str]:
        kinds = [word.partition("=")[0] for word in self.node if "=" in word]
        return list(dict.fromkeys([*kinds, *(word.partition(".")[0] for word in self.device)]))

    @property
    def base_device(self) -> Device:
        """The device of hosts that no word names; raise BadTopology."""
        kind = kind_of_all(self.node)
        return node_device(kind, self.preset) if kind else self.preset

    def of_hosts(self, hosts: Sequence[str]) -> "PartOptions":
        """Return the same with a word for each host that a pattern (*, r?) stands for.

        Raise BadTopology for a pattern of none.
        """
        words: list[str] = []
        for word in self.device:
            pattern, dot, setting = word.partition(".")
            if not dot or not is_pattern(word):
                words.append(word)
                continue
            meant = [host for host in hosts if fnmatchcase(host, pattern)]
            if not meant:
                raise BadTopology(f"--device {word}: no host is {pattern}, of {', '.join(hosts)}")
            words += (f"{host}{dot}{setting}" for host in meant)
        return replace(self, device=words)

    def set_parts(self, content: Content) -> None:
        """Change the parts of a topology as the words say; raise BadTopology, or ValueError."""
        self._set_fibers(content)
        self._set_switches(content)
        if self.named_hosts:
            self._set_devices(content)

    def _set_devices(self, content: Content) -> None:
        hosts = {host.name: host.info for host in content.of(QuantumHost)}
        others = {host: device_of(host, info) for host, info in hosts.items()}
        devices = _changed_devices(others | _named_nodes(self.node, self.preset), self.device)
        for host in self.named_hosts:
            _require("--node or --device", host, hosts)
            set_device(hosts[host], devices[host])

    def _set_fibers(self, content: Content) -> None:
        by_place = _fibers_by_place(content)
        changes: defaultdict[str, Info] = defaultdict(dict)
        for word, place, name, value in self._fibers:
            if place:
                place = place if place in by_place else _in_order(place, by_place)
                _require(f"--fiber {word}: no fibre", place, by_place)
                changes[place][name] = value
        for place, changed in changes.items():
            for info in by_place[place]:
                kind = KINDS.get(str(changed.get("kind", "")), {})
                info.update({**kind, **changed})
                optics_of_place = {name: info[name] for name in FIBER_OPTICS & info.keys()}
                resolved(optics(f"fibre {place}", **optics_of_place))

    def _set_switches(self, content: Content) -> None:
        switches = {switch.name: switch.info for switch in content.of(OpticalSwitch)}
        for word, place, name, value in _said("switch", self.switch, SWITCH):
            if place:
                _require(f"--switch {word}: no quantum switch", place, switches)
            for switch in [place] if place else switches:
                part, dot, setting = name.partition(".")
                info = switches[switch]
                if name == "parts":
                    where = f"--switch {word}: parts"
                    info.update(switch_parts(node_device(value, self.preset, where)))
                elif dot:
                    before = info.get(part, getattr(QuantumSwitch(""), part))
                    info[part] = replace(before, **{setting: value})
                else:
                    info[name] = value


def is_pattern(word: str) -> bool:
    """Return whether a word of --device is about all hosts of a pattern."""
    host = word.partition("=")[0].partition(".")[0]
    return any(sign in host for sign in "*?[")


def set_device(info: Info, device: Device) -> None:
    """Give a host another device; a source stays one."""
    info["source"] = bool(info.get("source"))
    for part in DEVICE_PARTS:
        if part != "source":
            info.pop(part, None)
    info["device"] = device


def _said(
    option: str, words: Sequence[str], choices: Mapping[str, Any]
) -> Iterator[tuple[str, str, str, Any]]:
    """Yield each word with its place, which may be "", name and value; raise BadTopology.

    Names are known with their defaults.
    """
    for word in words:
        where, equals, text = word.partition("=")
        place, name = place_and_name(where)
        if not equals:
            raise BadTopology(
                f"--{option} {word}: write NAME=VALUE or PLACE.NAME=VALUE, "
                f"where NAME is of {', '.join(choices)}"
            )
        check_names(f"--{option} {word}: a {KIND_OF[option]}", [name], choices, BadTopology)
        of_none = tuple if "." in name else float  # as of a host's device
        yield word, place, name, _value(f"--{option} {word}", name, text, choices[name], of_none)


def place_and_name(where: str) -> tuple[str, str]:
    """Return both of [PLACE.][PART.]NAME; a switch has parts."""
    place, _dot, name = where.rpartition(".")
    others, _dot, part = place.rpartition(".")
    return (others, f"{part}.{name}") if part in SWITCH_PARTS else (place, name)


def _value(where: str, name: str, text: str, default: Any, of_none: type = float) -> Any:
    """Return a parameter's value as the kind of its default, or that of one which may be None."""
    kind: Any = of_none if default is None else type(default)
    try:
        if kind in (int, float):
            return quantity(unit_of(name), text, kind)
        return kind(json.loads(text) if kind in (dict, tuple) else text)
    except (TypeError, ValueError) as error:
        raise BadTopology(f"{where}: {error}") from error


def _fibers_by_place(content: Content) -> dict[str, list[Info]]:
    """Return the fibres between two nodes by A-B, names in order."""
    fibers: defaultdict[str, list[Info]] = defaultdict(list)
    for link in content.links:
        if link.is_fiber:
            fibers["-".join(sorted((link.a.name, link.b.name)))].append(link.info)
    return dict(sorted(fibers.items()))


def _in_order(place: str, by_place: Collection[str]) -> str:
    """Return A-B for B-A, if there are such fibres; names may have hyphens of their own."""
    parts = place.split("-")
    for cut in range(1, len(parts)):
        other = f"{'-'.join(parts[cut:])}-{'-'.join(parts[:cut])}"
        if other in by_place:
            return other
    return place


def _require(what: str, name: str, names: Collection[str]) -> None:
    if name not in names:
        raise BadTopology(f"{what} {name}: choose one of {', '.join(names) or 'none'}")


def kind_of_all(words: Sequence[str]) -> str:
    """Return the kind of hosts that no word names, "" for none; raise BadTopology for two."""
    kinds = [word for word in words if "=" not in word]
    if len(kinds) > 1:
        raise BadTopology(f"--node {kinds[0]} and --node {kinds[1]}: choose one for all hosts")
    for kind in kinds:
        of_hosts = [name for name in NODE_KINDS if name != "station"]  # it is part of a network
        check_choice("--node", kind, of_hosts, BadTopology)
    return kinds[0] if kinds else ""


def _named_nodes(words: Sequence[str], preset: Device) -> dict[str, Device]:
    """Return the devices of the hosts whose kind is named; raise BadTopology."""
    devices: dict[str, Device] = {}
    for word in words:
        host, equals, kind = word.partition("=")
        if not equals:
            continue
        if not host or not kind or host in devices or "." in host:
            kinds, of_parts = ", ".join(NODE_KINDS), "; settings of hosts are words of --device"
            text = f"--node {word}: write KIND, or HOST=KIND once a host, of {kinds}"
            raise BadTopology(text + of_parts * ("." in host))
        devices[host] = node_device(kind, preset, f"--node {host}:")
    return devices


def _changed_devices(devices: Mapping[str, Device], words: Sequence[str]) -> dict[str, Device]:
    """Return devices by host with the parameters that words name; raise BadTopology."""
    devices_now = dict(devices)
    for word in words:
        place, _equals, text = word.partition("=")
        host, part, name = [*place.split(".", 2), "", ""][:3]
        if not text or not host or not name:
            raise BadTopology(
                f"--device {word}: write HOST.PART.NAME=VALUE, * for every HOST, and PART of "
                f"{', '.join(IDEAL)}"
            )
        check_names(f"--device {word}: a device", [part], IDEAL, BadTopology)
        before = devices_now.get(host, Device())
        changed = _changed_part(f"--device {word}", part, before, (name, text))
        devices_now[host] = replace(before, **{part: changed})
    for host, device in devices_now.items():
        device.check(host)
    return devices_now


def _changed_part(where: str, part: str, device: Device, setting: tuple[str, str]) -> Any:
    """Return a part with one setting: its own, or NOISE.NAME of a package's noise model."""
    (name, text), before, choices = setting, getattr(device, part), IDEAL[part]
    noise, dot, parameter = name.partition(".")
    if not dot or noise not in registered(NOISE):
        check_names(f"{where}: {part}", [name], choices, BadTopology)
        return replace(before, **{name: _value(where, name, text, choices[name], of_none=tuple)})
    check_names(f"{where}: {part}", ["noise"], choices, BadTopology)
    if before.noise not in ("", noise):
        raise BadTopology(f"{where}: {part} has the noise {before.noise}: choose one of both")
    value = _value(where, parameter, text, 0.0)
    others = before.noise_parameters
    return replace(before, noise=noise, noise_parameters={**others, parameter: value})
