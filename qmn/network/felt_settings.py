"""The settings of devices, fibres and switches that a job can feel; refusals of all others.

They follow from the roles of hosts in a session, and from what a host in a role needs
(wire.services). Presets and topologies serve many jobs: what they set is never refused.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, fields, replace
from itertools import pairwise
from typing import Any

import networkx

from qmn.network.description import NetworkDescription
from qmn.network.light_checks import making
from qmn.options import BadInput
from topologies.description.description import Description
from wire.features import EMIT, HERALD, INTERFERE, MEASURE, STORE
from wire.metadata.vocabulary import Service
from wire.parameters.physics import Device
from wire.services import RETURNS, Making, Role, beams, needs, uses_source

Settings = frozenset[str]  # PART.NAME
PARTS: dict[str, Any] = {each.name: each.default for each in fields(Device)}
EVERY: Settings = frozenset(
    f"{part}.{each.name}" for part, ideal in PARTS.items() for each in fields(ideal)
)


def _of(*parts: str) -> Settings:
    return frozenset(name for name in EVERY if name.partition(".")[0] in parts)


OF_PAIRS: Settings = frozenset({"source.fidelity", "source.bell_diagonal"})
OF_STATES: Settings = frozenset(
    {"source.preparation_error", "source.decoys", "source.heralding_efficiency"}
)
PAIRS, STATES = _of("source") - OF_STATES, _of("source") - OF_PAIRS
READOUT: Settings = frozenset({"gates.readout_s", "gates.readout_error"})
PROGRAMS: Settings = frozenset({"gates.initialization_s", "gates.initialization_error"})
GATES = _of("gates") - READOUT - PROGRAMS
PAULIS: Settings = frozenset(
    f"gates.{name}" for name in ("one_qubit_depolarizing", "one_qubit_s", "noise")
) | {"gates.noise_parameters"}
KEEPING = _of("memory", "detectors") | GATES | READOUT  # what is kept is measured, too
LOOKING = _of("detectors", "memory")  # light that comes before its order waits in the memory
EMITTING = _of("emitter") | {
    f"source.{name}" for name in ("statistics", "bandwidth_nm", "jitter_ps", "encoding")
}
STATION = _of("analyser", "detectors") | {"source.statistics"}  # a station has no pairs
RATE: Settings = frozenset({"source.max_rate_hz"})  # the slowest source limits every session
PREPARED = frozenset({Service.BB84, Service.MDI})  # services without pairs
BELL = {
    (Service.SDC, Role.ACCEPTOR),
    (Service.TELEPORT, Role.OPENER),
    (Service.SWAP, Role.REPEATER),
}
BESIDES = {
    (Service.SDC, Role.OPENER): PAULIS | _of("memory"),
    (Service.SDC_RETURN, Role.OPENER): PAULIS | _of("memory"),
    (Service.MDI, Role.SOURCE): _of("memory"),
    (Service.TELEPORT, Role.OPENER): STATES,
    (Service.SENSE, Role.OPENER): _of("sensor"),
    (Service.SENSE, Role.ACCEPTOR): _of("sensor"),
}
INSTEAD = {**dict.fromkeys(OF_PAIRS, "preparation_error"), "source.preparation_error": "fidelity"}


@dataclass(frozen=True)
class Felt:
    """The settings that a job can feel."""

    devices: dict[str, Settings] = field(default_factory=dict)  # of the hosts that take part
    ways: frozenset[frozenset[str]] | None = frozenset()  # neighbours with light; None: all

    def __or__(self, other: "Felt") -> "Felt":
        hosts = [*self.devices, *other.devices]
        nothing: Settings = frozenset()
        return Felt(
            {h: self.devices.get(h, nothing) | other.devices.get(h, nothing) for h in hosts},
            None if self.ways is None or other.ways is None else self.ways | other.ways,
        )


def everything(hosts: Iterable[str]) -> Felt:
    return Felt(dict.fromkeys(hosts, EVERY), None)


def felt_by(
    service: str,
    hosts: Sequence[str],
    parts: Description,
    source: str = "",
    separate: bool = False,
    anywhere: bool = False,
) -> Felt:
    """Return what a session of these hosts, each with the next, can feel.

    `source` makes the pairs, if a user names it; separate: each host makes probes of its own, and
    sends no light. Anywhere: light can go through all fibres.
    """
    asked = Service[service.upper()]
    found = Felt({}, None if separate or anywhere else frozenset())
    for opener, acceptor in pairwise(hosts):
        maker = source or parts.source_for(opener)
        by = making(asked, opener, maker, parts)
        roles = {Role.OPENER: opener, Role.ACCEPTOR: acceptor}
        if uses_source(asked, by) or by == Making.OPENER:
            roles[Role.SOURCE] = maker
        for role, host in roles.items():
            found |= Felt({host: _of_role(asked, role, by, parts.hosts[host])})
        if found.ways is not None:
            for begin, end in beams(asked, by):
                found |= Felt({}, _between(roles[begin.role], roles[end.role], parts))
    if asked == Service.SWAP:
        found |= _heralding_ends(parts, hosts) | _repeaters(parts, hosts)
    if separate:
        found = replace(
            found, devices={host: felt - PAIRS | STATES for host, felt in found.devices.items()}
        )
    if asked in RETURNS:
        found |= felt_by(RETURNS[asked].name, hosts[::-1], parts, source, anywhere=anywhere)
    return found


def _of_role(service: Service, role: Role, by: Making, device: Device) -> Settings:
    needed = needs(service, role, by)
    only_joined = (service, role) == (Service.TELEPORT, Role.OPENER)
    by_feature = {
        EMIT: STATES if service in PREPARED else PAIRS,
        STORE: _of("memory") if only_joined else KEEPING,
        MEASURE: LOOKING,
        HERALD: EMITTING,
        INTERFERE: STATION,
    }
    found = RATE | BESIDES.get((service, role), frozenset())
    found |= _bell(device) if (service, role) in BELL else frozenset()
    return found.union(*(felt for feature, felt in by_feature.items() if feature in needed))


def _bell(device: Device) -> Settings:
    """Return what a Bell measurement feels: of gates, or of an analyser for light."""
    if device.analyser.kind == "gates":
        return _of("detectors") | GATES | READOUT | {"analyser.kind"}
    return _of("analyser", "detectors")


def _heralding_ends(parts: Description, ends: Sequence[str]) -> Felt:
    """Return what ends of a chain feel that emit to a station between them and a repeater."""
    roles = {ends[0]: Role.OPENER, ends[-1]: Role.ACCEPTOR}
    return Felt(
        {
            host: _of_role(Service.SWAP, role, Making.STATION, parts.hosts[host])
            for host, role in roles.items()
            if HERALD in parts.hosts[host].features
        }
    )


def _repeaters(parts: Description, ends: Sequence[str]) -> Felt:
    found = Felt({}, None)
    for host in parts.hosts.keys() - {*ends}:
        device = parts.hosts[host]
        stated = STATION if device.is_station else frozenset[str]()
        for by in (Making.SOURCE, Making.STATION)[: 1 + (HERALD in device.features)]:
            stated |= _of_role(Service.SWAP, Role.REPEATER, by, device)
        found |= Felt({host: stated})
    return found


def _between(one: str, other: str, parts: Description) -> frozenset[frozenset[str]]:
    """Return the neighbours on any path of quantum switches between two hosts."""
    graph = networkx.Graph([(one, other)])
    passing = {one, other, *parts.switches, "eve"}
    graph.add_edges_from((f.a, f.b) for f in parts.fibers if {f.a, f.b} <= passing)
    for edges in networkx.biconnected_component_edges(graph):
        ways = frozenset(map(frozenset, edges))
        if {one, other} in ways:
            return ways
    raise AssertionError(f"no path from {one} to {other}")  # there is an edge


def checked_settings(job: str, felt: Felt, network: NetworkDescription) -> NetworkDescription:
    """Return the network with the settings of its hosts that the job does not feel.

    Raise BadInput for one that the command line names.
    """
    options, parts = network.options, network.parts
    if options.policy:  # which may have any host watch any fibre
        felt |= Felt(dict.fromkeys(parts.hosts, PAIRS | LOOKING), None)
    for word in options.node:
        host, equals, _kind = word.partition("=")
        if equals and host not in felt.devices:
            raise BadInput(f"--node {word}: {host} takes no part in {job}: leave it out")
    for word in options.device:
        host, _dot, setting = word.partition("=")[0].partition(".")
        if setting not in felt.devices.get(host, ()):
            raise BadInput(f"--device {word}: {_unfelt(job, host, setting, felt)}")
    _check_ways(job, felt, network)
    unused = (
        f"{host}.{part}.{name}"
        for host, settings in felt.devices.items()
        for part, names in parts.hosts[host].to_dict().items()
        for name in names
        if f"{part}.{name}" not in settings
    )
    return replace(network, unused_settings=tuple(unused))


def _unfelt(job: str, host: str, setting: str, felt: Felt) -> str:
    part, _dot, name = setting.partition(".")
    others = ", ".join(sorted(each for each in felt.devices if setting in felt.devices[each]))
    instead = INSTEAD.get(setting, "")
    if host not in felt.devices:
        text = f"{host} takes no part in {job}"
    elif any(each.startswith(f"{part}.") for each in felt.devices[host] - RATE):
        text = f"{job} does not use {name} of {host}'s {part}"
        if f"source.{instead}" in felt.devices[host]:
            return f"{text}: give {host}.source.{instead}"
    else:
        text = f"{job} does not use the {part} of {host}"
    return f"{text}: give it for {others}" if others else f"{text}: leave it out"


def _check_ways(job: str, felt: Felt, network: NetworkDescription) -> None:
    """Raise BadInput for a fibre, or a quantum switch, through which no light of the job goes."""
    if felt.ways is None:
        return
    lit = {f"{a}-{b}" for way in felt.ways for a in way for b in way if a != b}
    nodes = frozenset().union(*felt.ways)
    taking_part = {*felt.devices, *network.parts.switches}
    copper = {f"{a}-{b}" for a in taking_part for b in taking_part}  # is as long as fibres there
    for option, words, known in (
        ("fiber", network.options.fiber, lit),
        ("switch", network.options.switch, nodes),
    ):
        for word in words:
            place, _dot, name = word.partition("=")[0].rpartition(".")
            if place and place not in known and not (name == "length_km" and place in copper):
                text = f"no light of {job} goes through {place}"
                raise BadInput(f"--{option} {word}: {text}: leave it out")
