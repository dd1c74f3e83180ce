"""The job of heavy traffic: qmn run load. Many hosts ask for many sessions at a time."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import groupby, product
from operator import itemgetter
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from evidence.traffic import job_result as load_result
from evidence.traffic.driver import Driver
from evidence.traffic.plan import BadTraffic, Planned, Traffic, plan
from evidence.traffic.request import LINE, OWN, LoadRequest
from evidence.traffic.session import PAIR, Wanted
from evidence.traffic.summary import summary
from hosts.middleware.services import named
from hosts.middleware.session.errors import SessionError
from hosts.network_loop import run as run_loop
from qmn.jobs.counted_service import described, swaps_from
from qmn.jobs.run_context import RunContext, ending, known_facts, running_network
from qmn.network.checks import check_network
from qmn.network.description import NetworkDescription
from qmn.network.felt_settings import Felt, checked_settings, felt_by
from qmn.network.light_checks import check_source
from qmn.options import BadInput, check_ranges
from qmn.results.result import network_facts
from qmn.results.run_folder import begin_folder
from qmn.results.run_result import RunResult
from topologies.description.description import Description
from topologies.networks.network import Network, Signals
from topologies.networks.requirements import require_free
from wire.controller_lines import read_record
from wire.metadata.vocabulary import Service
from wire.parameters.checks import remedy
from wire.results.run_result import ACCEPTED, LoadJob
from wire.services import LINES, RETURNS

CONTROLLER = "c0"
BYTES = ("sdc", "sdc_return")  # services that carry some
MEASURED = ("distribute", "swap")  # services that leave pairs at both ends


def run(request: LoadRequest, signals: Signals, console: Console) -> int:
    """Do the whole run and return its exit status: 0 if every session has been answered."""
    request, network, traffic, planned, wanted = checked(request)
    require_free(network.topo)
    folder = begin_folder(request.run.runs, "load")
    context = RunContext(network, request.run, folder, signals, console)
    hosts = [*traffic.openers, *(each for each in traffic.acceptors if each not in traffic.openers)]
    facts = known_facts(context, request.service, hosts, LoadJob(), request)
    with ending(folder, facts, load_result.complete, context.options.report) as ended:
        _drive(request, traffic, planned, wanted, context, facts)
    load_result.show(console, facts, folder, ended.report)
    return 0 if facts.delivered else 1


def checked(
    request: LoadRequest,
) -> tuple[LoadRequest, NetworkDescription, Traffic, list[Planned], Wanted]:
    """Return the request with what follows from it, its network, and what will be asked for.

    Raise BadInput or BadTopology before anything is started.
    """
    network = described(request.service, request.network)
    with_parts = replace(request.network, switch=network.options.switch)
    request = replace(request, network=with_parts)
    check_network(request.network)
    check_ranges(request.run)
    network = network.paced_for(*request.run.against_steps)
    check_ranges(request)
    traffic = traffic_of(request, network)
    if not request.source:
        check_source(request.service, network.parts)
    try:
        planned = plan(request.traffic, traffic, request.network.seed, request.sessions)
    except BadTraffic as error:
        raise BadInput(str(error)) from error
    wanted = wanted_of(request, network.hosts)
    if Service[request.service.upper()] == Service.SWAP:
        wanted = replace(wanted, swaps=dict(swaps_of(traffic, planned, network.parts)))
    felt = felt_by_any(request, traffic, network)
    network = checked_settings(request.service, felt, network)
    return request, network, traffic, planned, wanted


def swaps_of(
    traffic: Traffic, planned: Sequence[Planned], parts: Description
) -> Iterator[tuple[tuple[str, str], int]]:
    """Yield the ends of each session that there may be, and in how many switches they swap."""
    ends = {(each.opener, each.acceptor) for each in planned}
    if traffic.idle:
        ends = {each for each in product(traffic.openers, traffic.acceptors) if len({*each}) > 1}
    for opener, group in groupby(sorted(ends), itemgetter(0)):
        swaps = swaps_from(opener, [acceptor for _opener, acceptor in group], parts)
        yield from (((opener, acceptor), number) for acceptor, number in swaps.items())


def felt_by_any(request: LoadRequest, traffic: Traffic, network: NetworkDescription) -> Felt:
    """Return the settings that one session or another feels; a line can begin at any host."""
    hosts = sorted({*traffic.openers, *traffic.acceptors})
    in_line = Service[request.service.upper()] in LINES
    openers = set(hosts if in_line else traffic.openers)
    acceptors = hosts if in_line else sorted(traffic.acceptors)
    felt = Felt()
    for host in hosts:  # as opener, as acceptor
        pairs = (
            [(host, next(each for each in acceptors if each != host))] if host in openers else []
        )
        if host in acceptors:
            pairs.append((next(each for each in sorted(openers) if each != host), host))
        for opener, acceptor in pairs:
            source = opener if request.source == OWN else request.source
            ends = opener, acceptor
            felt |= felt_by(request.service, ends, network.parts, source)
    return felt.any_to_any()


def traffic_of(request: LoadRequest, network: NetworkDescription) -> Traffic:
    """Return the model's parameters; raise BadInput for hosts there are not."""
    hosts = network.hosts
    others = [host for host in hosts if host not in network.parts.sources]
    openers = chosen("--from", request.senders, network) or others
    acceptors = chosen("--to", request.receivers, network) or others
    each = hosts_of_session(request)
    if not openers or any(len({*acceptors} - {host}) < each - 1 for host in openers):
        raise BadInput(
            f"--from {','.join(openers)} --to {','.join(acceptors)}: name more hosts, "
            f"{each} take part in a session"
        )
    if request.file is not None and request.traffic not in ("matrix", "trace"):
        raise BadInput(f"--file is of --traffic matrix or trace, not of {request.traffic}")
    if request.idle and request.traffic != "poisson":
        raise BadInput("--idle is of --traffic poisson: the others say who asks")
    return Traffic(
        openers,
        acceptors,
        request.rate_per_s,
        request.holding_s,
        request.constant,
        request.deadline_s,
        request.urgent,
        request.idle,
        request.on_s,
        request.off_s,
        request.file,
        each,
    )


def hosts_of_session(request: LoadRequest) -> int:
    """Return how many hosts take part in each; raise BadInput for a line of a service of two."""
    if Service[request.service.upper()] in LINES:
        return request.line or LINE
    if request.line is not None:
        raise BadInput(f"--line: in {request.service} {PAIR} hosts take part: leave it out")
    return PAIR


def chosen(option_name: str, named: str, network: NetworkDescription) -> list[str]:
    """Return the hosts that are named with commas; raise BadInput for one there is not."""
    hosts = [network.node(name) for name in named.split(",") if name]
    for name in hosts:
        if name not in network.hosts:
            raise BadInput(f"{option_name} {name}: {remedy(name, network.hosts)}")
    return hosts


def wanted_of(request: LoadRequest, hosts: Sequence[str]) -> Wanted:
    """Return what each session asks for; raise BadInput for what its service does not take."""
    opener_makes = request.source == OWN
    if request.source and request.service == "swap":
        raise BadInput("--source: in swap both ends make pairs: leave it out")
    if request.source and not opener_makes and request.source not in hosts:
        raise BadInput(f"--source {request.source}: {remedy(request.source, [OWN, *hosts])}")
    options: dict[str, Any] = (
        {} if opener_makes or not request.source else {"source": request.source}
    )
    data = bytes(n % 256 for n in range(request.count)) if request.service in BYTES else b""
    if not data:
        options |= {"count": request.count}
    measures = request.service in MEASURED
    if measures:
        options["sample"] = 0.0
    fields_, service = {"host": hosts[1], "port": 1, **options}, Service[request.service.upper()]
    if service in LINES:
        fields_["line"] = ",".join(hosts[: hosts_of_session(request)])
    try:
        named()[request.service].options.from_fields(fields_)
    except SessionError as error:
        raise BadInput(f"--service {request.service}: {error}") from error
    return Wanted(
        service,
        options,
        data,
        opener_makes,
        measures,
        hosts_of_session(request),
        RETURNS.get(service),
    )


def _drive(
    request: LoadRequest,
    traffic: Traffic,
    planned: Sequence[Planned],
    wanted: Wanted,
    context: RunContext,
    facts: RunResult,
) -> None:
    with running_network(context, facts) as network:
        context.console.print(
            f"{len(planned):,} sessions of {request.service} ({request.traffic}) in "
            f"{planned[-1].at_s:.3g} s"
        )
        driver = Driver(
            planned,
            wanted,
            {host: network.runtime.socket(host) for host in network.runtime.devices},
            (traffic.openers, traffic.acceptors),
            request.network.seed,
            network.runtime.time,
        )
        before_s = controller_s(network)
        try:
            _follow(driver, len(planned), network, context.console)
        finally:
            load = summary(
                driver.outcomes,
                read_record(network.runtime.logs),
                network.runtime.time.scale,
                driver.began_ns,
                {address: name for name, address in network_facts(network).addresses.items()},
            )
            load.controller_ms = 1e3 * (controller_s(network) - before_s) / len(planned)
            load.began_ns = driver.began_ns
            facts.job = LoadJob(load=load)
        facts.delivered = len(driver.outcomes) == len(planned) and not driver.under_way


def _follow(driver: Driver, total: int, network: Network, console: Console) -> None:
    text = "{task.fields[held]} under way, {task.fields[refused]} refused"
    with Progress(
        *(TextColumn("sessions"), BarColumn(), MofNCompleteColumn(), TextColumn(text)),
        TimeElapsedColumn(),
        console=console,
    ) as bar:
        task = bar.add_task("sessions", total=total, held=0, refused=0)

        def check() -> None:
            network.check()
            over = [each for each in driver.outcomes if each.outcome]
            refused = sum(each.outcome != ACCEPTED for each in over)
            bar.update(task, completed=len(over), held=driver.under_way, refused=refused)

        run_loop(driver.run(check), network.runtime.time)
        check()


def controller_s(network: Network) -> float:
    (program,) = (each for each in network.runtime.programs if each.name == CONTROLLER)
    return program.processor_s
