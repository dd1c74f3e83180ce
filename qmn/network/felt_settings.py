"""The settings of devices, fibres and switches that a job can feel; refusals of all others.

They follow from the roles of hosts in a session, and from what a host in a role needs
(wire.services). Presets and topologies serve many jobs: what they set is never refused.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, fields, replace
from itertools import pairwise, product
from typing import Any, NamedTuple

import networkx

from qmn.network.description import NetworkDescription
from qmn.network.light_checks import making
from qmn.network.options import MAP
from qmn.network.part_options import is_pattern, place_and_name
from qmn.options import BadInput
from topologies.description.description import Description
from wire.features import EMIT, HERALD, INTERFERE, MEASURE, STORE
from wire.light import Role
from wire.metadata.vocabulary import Service
from wire.parameters.physics import Device
from wire.services import PREPARED, RETURNS, Making, beams, joins, needs, used_parts, uses_source

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
BELL = {
    (Service.SDC, Role.ACCEPTOR),
}
BESIDES = {
    (Service.SDC, Role.OPENER): PAULIS | _of("memory"),
    (Service.SDC_RETURN, Role.OPENER): PAULIS | _of("memory"),
}
# What a map gives all its hosts, whether a job measures there or not:
OF_MAPS: Settings = frozenset({"analyser.delay_line_km", "analyser.delay_line_db_per_km"})
EVE = "eve"  # passes light on
NODES = {"fiber": "fibre", "switch": "quantum switch"}
INSTEAD = {**dict.fromkeys(OF_PAIRS, "preparation_error"), "source.preparation_error": "fidelity"}


@dataclass(frozen=True)
class Felt:
    """The settings that a job can feel."""

    devices: dict[str, Settings] = field(default_factory=dict)  # of the hosts that take part
    beams: frozenset["HostBeams"] = frozenset()

    def __or__(self, other: "Felt") -> "Felt":
        hosts = [*self.devices, *other.devices]
        nothing: Settings = frozenset()
        return Felt(
            {h: self.devices.get(h, nothing) | other.devices.get(h, nothing) for h in hosts},
            self.beams | other.beams,
        )

    def any_to_any(self) -> "Felt":
        """Return the same with light from each host that emits to each that receives."""
        emitters = frozenset[str]().union(*(beam.emitters for beam in self.beams))
        receivers = frozenset[str]().union(*(beam.receivers for beam in self.beams))
        return replace(self, beams=frozenset({HostBeams(emitters, receivers)}))


class HostBeams(NamedTuple):
    """Light from each of some hosts to each of others."""

    emitters: frozenset[str]
    receivers: frozenset[str]


def everything(hosts: Iterable[str]) -> Felt:
    """Return every setting of these hosts, with light between all of them."""
    named = frozenset(hosts)
    return Felt(dict.fromkeys(named, EVERY), frozenset({HostBeams(named, named)}))


def felt_by(
    service: str,
    hosts: Sequence[str],
    parts: Description,
    source: str = "",
    sends_light: bool = True,
) -> Felt:
    """Return what a session of these hosts, each with the next, can feel.

    `source` makes the pairs, if a user names it.
    """
    kind = Service[service.upper()]
    settings = Felt()
    for opener, acceptor in pairwise(hosts):
        maker = source or parts.source_for(opener)
        by = making(kind, opener, source, parts)
        roles = {Role.OPENER: opener, Role.ACCEPTOR: acceptor}
        if uses_source(kind, by) or by == Making.OPENER:
            roles[Role.SOURCE] = maker
        for role, host in roles.items():
            settings |= Felt({host: _of_role(kind, role, by, parts.hosts[host])})
        for start, end in beams(kind, by) if sends_light else ():
            light = HostBeams(frozenset({roles[start.role]}), frozenset({roles[end.role]}))
            settings |= Felt({roles[end.role]: _of("compensator")}, frozenset({light}))
        if kind == Service.SWAP or by == Making.STATION:  # light goes to switches between them
            ends = frozenset({opener, acceptor})
            settings |= Felt({}, frozenset({HostBeams(ends, ends)}))
    if not sends_light:
        settings = replace(
            settings,
            devices={host: felt - PAIRS | STATES for host, felt in settings.devices.items()},
        )
    if kind in RETURNS:
        settings |= felt_by(RETURNS[kind].name, hosts[::-1], parts, source)
    return settings


def _of_role(service: Service, role: Role, by: Making, device: Device) -> Settings:
    needed = needs(service, role, by)
    joined = joins(service, role)
    by_feature = {
        EMIT: STATES if service in PREPARED else PAIRS,
        STORE: _of("memory") if joined else KEEPING,
        MEASURE: LOOKING,
        HERALD: EMITTING,
        INTERFERE: STATION,
    }
    settings = RATE | BESIDES.get((service, role), frozenset()) | _of(*used_parts(service, role))
    settings |= STATES if joined else frozenset()
    settings |= _bell(device) if joined or (service, role) in BELL else frozenset()
    return settings.union(*(felt for feature, felt in by_feature.items() if feature in needed))


def _bell(device: Device) -> Settings:
    """Return what a Bell measurement feels: of gates, or of an analyser for light."""
    if device.analyser.kind == "gates":
        return _of("detectors") | GATES | READOUT | {"analyser.kind"}
    return _of("analyser", "detectors")


def _lit_fibers(light: HostBeams, parts: Description) -> frozenset[frozenset[str]]:
    """Return the neighbours on any path of quantum switches from an emitter to a receiver.

    A host that does both is two nodes: paths end at hosts. A fibre is on a path from the start to
    the goal if it shares a cycle with an edge between these two.
    """
    start, goal = ("start", ""), ("goal", "")
    passing = {*parts.switches, EVE}

    def nodes(name: str) -> list[tuple[str, str]]:
        if name in passing:
            return [("passing", name)]
        kinds = {"emitter": light.emitters, "receiver": light.receivers}
        return [(kind, name) for kind, hosts in kinds.items() if name in hosts]

    graph = networkx.Graph([(start, goal)])
    graph.add_edges_from((start, ("emitter", host)) for host in light.emitters)
    graph.add_edges_from((("receiver", host), goal) for host in light.receivers)
    for fiber in parts.fibers:
        ends = product(nodes(fiber.a), nodes(fiber.b))
        graph.add_edges_from((a, b) for a, b in ends if a[0] != b[0] or a[0] == "passing")
    for edges in networkx.biconnected_component_edges(graph):
        joined = frozenset(map(frozenset, edges))
        if {start, goal} in joined:
            named = (frozenset(name for _kind, name in edge) for edge in joined)
            return frozenset(edge for edge in named if "" not in edge)
    raise AssertionError("an edge is in some component")


def checked_settings(job: str, felt: Felt, network: NetworkDescription) -> NetworkDescription:
    """Return the network with the settings of its hosts that the job does not feel.

    Raise BadInput for one that the command line names.
    """
    options, parts = network.options, network.parts
    if options.policy:  # which may have any host watch any fibre
        watching = replace(everything(parts.hosts), devices={})
        felt |= Felt(dict.fromkeys(parts.hosts, PAIRS | LOOKING)) | watching
    for word in options.node:
        host, equals, _kind = word.partition("=")
        if equals and host not in felt.devices:
            raise BadInput(f"--node {word}: {host} takes no part in {job}: leave it out")
    for word in options.device:
        host, _dot, setting = word.partition("=")[0].partition(".")
        if is_pattern(word):
            if not any(setting in settings for settings in felt.devices.values()):
                raise BadInput(f"--device {word}: {job} does not use {setting}: leave it out")
        elif setting not in felt.devices.get(host, ()):
            raise BadInput(f"--device {word}: {_unfelt(job, host, setting, felt)}")
    _check_fibers_and_switches(job, felt, network)
    silent = OF_MAPS if options.topology == MAP else frozenset()
    unused = (
        f"{host}.{part}.{name}"
        for host, settings in felt.devices.items()
        for part, names in parts.hosts[host].to_dict().items()
        for name in names
        if f"{part}.{name}" not in settings | silent
    )
    return replace(network, unused_settings=tuple(unused))


def _unfelt(job: str, host: str, setting: str, felt: Felt) -> str:
    part, _dot, name = setting.partition(".")
    others = ", ".join(sorted(device for device in felt.devices if setting in felt.devices[device]))
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


def _check_fibers_and_switches(job: str, felt: Felt, network: NetworkDescription) -> None:
    """Raise BadInput for a fibre, or a quantum switch, through which no light of the job goes."""
    options, parts = network.options, network.parts
    shorthands = [
        f"--{name.replace('_', '-')}"
        for name in ("loss_db_per_km", "depolarizing", "kind")
        if getattr(options, name) is not None
    ]
    if not (options.fiber or options.switch or shorthands):
        return
    lit = frozenset[frozenset[str]]().union(*(_lit_fibers(light, parts) for light in felt.beams))
    taking_part = {*felt.devices, *parts.switches}
    copper = {f"{a}-{b}" for a in taking_part for b in taking_part}  # is as long as fibres there
    fibers = {f"{a}-{b}" for edge in lit for a in edge for b in edge if a != b}
    switches = frozenset[str]().union(*lit) & {*parts.switches}
    for option, words, names in (
        ("fiber", options.fiber, fibers),
        ("switch", options.switch, switches),
    ):
        for word in words:
            place, name = place_and_name(word.partition("=")[0])
            if name == "length_km" and (not place or place in copper):
                continue
            if place and place not in names:
                text = f"no light of {job} goes through {place}"
            elif not names:
                text = f"no light of {job} goes through any {NODES[option]}"
            else:
                continue
            raise BadInput(f"--{option} {word}: {text}: leave it out")
    if shorthands and not fibers:
        raise BadInput(f"{shorthands[0]}: no light of {job} goes through any fibre: leave it out")
