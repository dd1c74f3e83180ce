"""The jobs of services that are about a number of things, as states or pairs: qmn run SERVICE."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import cycle
from math import ceil
from pathlib import Path
from typing import NamedTuple

from rich.console import Console

from controller_apps.policy.schedules import PARALLEL
from hosts.middleware.services.swapping import MOST_SWITCHES, SwapOptions
from hosts.middleware.session.errors import SessionError
from hosts.middleware.session.options import ServiceOptions
from hosts.timeouts import MAX_BLOCK_S
from qmn.jobs import eavesdropping, runner
from qmn.jobs.eavesdropping import Attack
from qmn.jobs.policies import scheduling_policy, tapping_policy
from qmn.jobs.run_context import RunContext
from qmn.network.checks import FROM_TO, LINE, check_network, check_two_hosts
from qmn.network.custom_topology import is_custom
from qmn.network.description import NetworkDescription, describe_network, no_parts
from qmn.network.felt_settings import Felt, checked_settings, everything, felt_by
from qmn.network.light_checks import analysers_from, check_light, weak_pulses
from qmn.network.options import NetworkOptions
from qmn.network.part_options import kind_of_all
from qmn.options import BadInput, check_ranges
from qmn.requests.service import ServiceRequest
from qmn.requests.service_verbs import Verb, verb_of
from qmn.results.run_folder import begin_folder
from topologies.catalogue.node_kinds import node_device
from topologies.description.description import Description
from topologies.networks.network import Signals
from topologies.networks.requirements import require_free
from wire.features import EMIT
from wire.light import Role
from wire.metadata.vocabulary import Service
from wire.parameters.checks import remedy
from wire.parameters.physics import BEAM_SPLITTER, Device
from wire.services import BY_KEY, PREPARED, is_heralded, is_relayed, used_parts, uses_source
from wire.socket_calls import SPLIT

PARTS: tuple[str, ...] = (
    "analysers=1",
    "memories=2",
    "sources=1",
)  # of a switch that swaps, for --switch


class Length(NamedTuple):
    """The end of a session: a total of a unit, by a field of its opener's figures."""

    unit: str
    total: int
    field: str


def run(request: ServiceRequest, signals: Signals, console: Console) -> int:
    return 0 if runner.run(*begun(request, signals, console)).delivered else 1


def begun(
    request: ServiceRequest, signals: Signals, console: Console
) -> tuple[runner.Job, RunContext]:
    """Return the job and its context, with a folder; raise before there is one."""
    request, network = checked(request)
    require_free(network.topo)
    folder = begin_folder(request.run.runs, request.service)
    network = with_policy(request, network, folder)
    context = RunContext(network, request.run, folder, signals, console)
    return job(request, network), context


def with_policy(
    request: ServiceRequest, network: NetworkDescription, folder: Path
) -> NetworkDescription:
    """Return the network with the policy that eve or a schedule need, written into the folder."""
    if request.eve is not None:
        ends = request.sender, request.receiver
        path = eavesdropping.tapped_path(request.service, ends, request.options.source, network)
        return network.with_policy(tapping_policy(*path, eavesdropping.EVE, folder))
    if request.schedule is not None or request.purify is not None:
        return network.with_policy(
            scheduling_policy(request.schedule or PARALLEL, request.purify or 0, folder)
        )
    return network


def job(request: ServiceRequest, network: NetworkDescription) -> runner.Job:
    service, options, verb = request.service, request.options, verb_of(request.service)
    length = length_of(options, verb)
    return runner.Job(
        service=service,
        options=options,
        opener=request.sender,
        acceptor=request.receiver,
        others=request.others,
        request=replace(request, phases_rad=_phases(request, network)),
        announcement=f"{service} {_between(request)}: {length.total:,} {length.unit}",
        unit=length.unit,
        total=length.total,
        done=lambda figures: int(getattr(figures, length.field, 0)),
        eve=attack_of(request, network),
        hand_out=request.hand_out,
    )


def length_of(options: ServiceOptions, verb: Verb) -> Length:
    if options.lasts_s:
        return Length("seconds", ceil(options.lasts_s), "elapsed_s")
    return Length(verb.unit.replace("_", " "), options.count, verb.unit)


def _phases(request: ServiceRequest, network: NetworkDescription) -> tuple[float, ...] | None:
    """Return the phases that the hosts of a line estimate without knowing them."""
    if "sensor" not in used_parts(Service[request.service.upper()], Role.OPENER):
        return None
    hosts = request.sender, request.receiver, *request.others
    return tuple(network.parts.hosts[name].sensor.phase_rad for name in hosts)


def _between(request: ServiceRequest) -> str:
    if request.others:
        return f"of {', '.join((request.sender, request.receiver, *request.others))}"
    return f"from {request.sender} to {request.receiver}"


def attack_of(request: ServiceRequest, network: NetworkDescription) -> Attack | None:
    if request.eve is None:
        return None
    if request.eve_attack == SPLIT:
        hides_db = request.eve_hides_db or 0.0
        return eavesdropping.splitting(hides_db, request.receiver, network.parts)
    return Attack(request.eve)


def check_attack(request: ServiceRequest) -> None:
    """Raise BadInput for what eve cannot do."""
    splits = request.eve_attack == SPLIT
    if splits and request.eve != 1:
        raise BadInput(f"--eve-attack {SPLIT} is on every pulse: say --eve 1")
    if splits and not is_prepared(request.service):
        raise BadInput(
            f"--eve-attack {SPLIT}: in {request.service} no sender prepares pulses; "
            "choose --protocol bb84"
        )
    if request.eve_hides_db is not None and not splits:
        raise BadInput(f"--eve-hides-db is of --eve-attack {SPLIT}: say both, or neither")


def check_turns(request: ServiceRequest) -> None:
    """Raise BadInput for turns of swaps that a policy decides on."""
    if request.network.policy and (request.schedule, request.purify) != (None, None):
        text = "--schedule and --purify make a policy of their own"
        raise BadInput(f"{text}: write [swap] schedule and rounds into --policy")


def is_prepared(service: str) -> bool:
    """Return whether one host sends the other states of its own."""
    return (service_ := Service[service.upper()]) in PREPARED and not uses_source(service_)


def checked(request: ServiceRequest) -> tuple[ServiceRequest, NetworkDescription]:
    """Return the request with what follows from it, and its network.

    Raise BadInput or BadTopology before anything is started.
    """
    if request.eve is not None:
        request = replace(request, network=eavesdropping.with_eve(request.network))
    network = described(request.service, request.network)
    with_parts = replace(request.network, switch=network.options.switch)
    request, network, felt = fitted(replace(request, network=with_parts), network)
    return request, checked_settings(request.service, felt, network)


def fitted(
    request: ServiceRequest, network: NetworkDescription
) -> tuple[ServiceRequest, NetworkDescription, Felt]:
    """Return the request as a network has it, the network, and what of its settings it can feel.

    Raise BadInput for what cannot be done there.
    """
    options = replace(request.options, host=network.node(request.receiver))
    request = replace(request, sender=network.node(request.sender), options=options)
    if is_relayed(Service[request.service.upper()]):
        request, network = with_beam_splitter(request, network)
    check_hosts(request, network)
    if isinstance(request.options, SwapOptions):
        options = with_swaps(request.options, request.sender, network.parts)
        request = replace(request, options=options)
    named = verb_of(request.service).source
    taking_part = request.sender, request.receiver, *request.others
    source = request.options.source
    check_light(request.service, taking_part, network.parts, source, named)
    felt = felt_by(request.service, taking_part, network.parts, source, request.options.sends_light)
    check_network(request.network)
    check_ranges(request.run)
    network = network.paced_for(*request.run.against_steps)
    check_ranges(request)
    check_attack(request)
    if request.hand_out is not None and request.hand_out.exists():
        raise BadInput(f"--hand-out {request.hand_out} exists: name a new folder")
    if request.eve is not None:
        felt |= everything([eavesdropping.EVE])
        eavesdropping.check((request.sender, request.receiver), network)
        attack_of(request, network)  # whether it can be
    check_turns(request)
    options = fitting_light(request, network.parts)
    check_options(options, request.network.backend)
    return replace(request, options=options), network, felt


def check_hosts(request: ServiceRequest, network: NetworkDescription) -> None:
    """Raise BadInput for hosts of a session, or a source, that the network does not have."""
    option = LINE if verb_of(request.service).line else FROM_TO
    check_two_hosts(request.sender, request.receiver, network.hosts, network.dark_hosts, option)
    for name in request.others:
        if name not in network.hosts:
            raise BadInput(f"{LINE} {name}: {remedy(name, network.hosts)}")
    check_source(request.options, network.hosts)


def described(service: str, options: NetworkOptions) -> NetworkDescription:
    """Return the network with parts in all switches of a topology of ours, if options name none.

    Of hosts whose memories emit every second one is as they are, and those between are stations;
    where no switch swaps, all are.
    """
    kind_of_session = Service[service.upper()]

    def parts(switches: Sequence[str]) -> Sequence[str]:
        kind = kind_of_all(options.node)
        if kind and is_heralded(kind_of_session, node_device(kind, Device()).features):
            kinds = cycle(("station", kind if kind_of_session == Service.SWAP else "station"))
            return [f"{name}.parts={each}" for name, each in zip(switches, kinds, strict=False)]
        return PARTS if kind_of_session == Service.SWAP else ()

    named = any("analysers=" in word or "parts=" in word for word in options.switch)
    has_parts = named or is_custom(options.topology)
    return describe_network(options, no_parts if has_parts else parts)


def with_swaps(options: SwapOptions, sender: str, parts: Description) -> SwapOptions:
    """Return the options with a number of swaps; raise BadInput for one that cannot be."""
    able = swaps_from(sender, [options.host], parts)[options.host]
    most = sum(switch.analysers > 0 for switch in parts.switches.values())
    if options.swaps > most:
        raise BadInput(f"--swaps {options.swaps}: {most} switches can swap; choose at most {most}")
    heralded = is_heralded(Service.SWAP, parts.hosts[sender].features)
    if heralded and options.swaps and options.swaps % 2 == 0:
        text = "a heralded chain begins and ends with a station: choose an odd number"
        raise BadInput(f"--swaps {options.swaps}: {text}")
    return replace(options, swaps=options.swaps or able)


def swaps_from(sender: str, receivers: Iterable[str], parts: Description) -> dict[str, int]:
    """Return in how many switches to swap, by receiver: in each that can.

    Raise BadInput if none is between the two hosts.
    """
    analysers, swaps = analysers_from(sender, parts), dict[str, int]()
    for host in receivers:
        able = int(analysers.get(host, 0))
        if is_heralded(Service.SWAP, parts.hosts[sender].features):
            able = max(0, able - 1 + able % 2)  # a chain begins and ends with a station
        if not able:
            raise BadInput(
                f"swap needs light from {sender} and {host} to a quantum switch with a Bell "
                "analyser between them: choose --topology chain,3, or give your switches parts "
                f"({' '.join(f'--switch {part}' for part in PARTS)})"
            )
        swaps[host] = min(able, MOST_SWITCHES)
    return swaps


def with_beam_splitter(
    request: ServiceRequest, network: NetworkDescription
) -> tuple[ServiceRequest, NetworkDescription]:
    """Return both with a beam splitter at the relay, if no option names its analyser."""
    relay = request.options.source or network.parts.source_for(request.sender)
    option = f"{relay}.analyser.kind="
    named = any(word.startswith(option) for word in request.network.device)
    if relay in network.hosts and not named:
        network = network.with_analyser(relay, BEAM_SPLITTER)
    return replace(request, network=network.options), network


def check_source(options: ServiceOptions, hosts: Sequence[str]) -> None:
    if options.source and options.source not in hosts:
        raise BadInput(f"--source {options.source}: {remedy(options.source, hosts)}")


def check_options(options: ServiceOptions, backend: str) -> None:
    """Raise BadInput for what the service, or what simulates its states, would not take."""
    try:
        options.check()
        options.check_backend(backend)
    except SessionError as error:
        raise BadInput(str(error)) from error


def fitting_light(request: ServiceRequest, parts: Description) -> ServiceOptions:
    """Return the session's options with a rate and a size of blocks that every source can make.

    Values that the user named stay. Blocks are long, if few of their pulses may click.
    """
    options, rate_hz, block_pairs = request.options, request.rate_hz, request.block_pairs
    sources = [device.source for device in parts.hosts.values() if EMIT in device.features]
    if rate_hz is None:
        slowest = min((source.max_rate_hz for source in sources), default=options.rate_hz)
        rate_hz = max(1, int(min(options.rate_hz, slowest)))
    if block_pairs is None:
        block_pairs = min(options.block_pairs, max(1, int(rate_hz * MAX_BLOCK_S)))
        if (service := Service[request.service.upper()]) in BY_KEY and request.eve is None:
            ends, maker = [request.receiver], request.sender
            if uses_source(service):
                ends.append(maker)
                maker = options.source or parts.source_for(maker)
            block_pairs = max(block_pairs, weak_pulses(maker, ends, parts, rate_hz))
    return replace(options, rate_hz=rate_hz, block_pairs=block_pairs)
