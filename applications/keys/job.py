"""qmn run keys: hosts keep their key stores filled, and deliver keys by ETSI GS QKD 014."""

import math
import time
from collections.abc import Mapping
from dataclasses import replace
from functools import partial, reduce
from operator import or_

from rich.console import Console

from applications.keys import time_series
from applications.keys.key_managers import (
    KeyManagers,
    KeyService,
    application_name,
    start_key_managers,
)
from applications.keys.options import key_service
from applications.keys.request import KeysRequest
from applications.keys.scheduled_eavesdropper import ScheduledEavesdropper, check_schedule
from applications.keys.time_series import TimeSeries
from programs.network_waits import NetworkWaits
from qmn.jobs import eavesdropping
from qmn.jobs.run_context import RunContext, ending, known_facts, running_network
from qmn.network.checks import check_network
from qmn.network.description import NetworkDescription, describe_network
from qmn.network.felt_settings import checked_settings, everything, felt_by
from qmn.network.light_checks import check_light
from qmn.options import check_ranges
from qmn.results import result
from qmn.results.run_folder import begin_folder
from topologies.networks.network import Interrupted, Network, Signals
from topologies.networks.requirements import require_free
from topologies.system.processes.programs import Program
from topologies.timeouts import POLL_S
from wire.results.run_result import KeysJob
from wire.results.time_series import Moment, SessionMoment

NAME = "keys"
PAIR = "alice:bob"  # that keeps keys if none is named


def checked(request: KeysRequest) -> tuple[KeysRequest, NetworkDescription]:
    """Return the request with what follows from it, and its network.

    Raise BadInput or BadTopology before anything is started.
    """
    if request.eve.eve is not None:
        request = replace(request, network=eavesdropping.with_eve(request.network))
    if not request.keys.key_pair:
        request = replace(request, keys=replace(request.keys, key_pair=(PAIR,)))
    network = describe_network(request.network)
    check_network(request.network)
    check_ranges(request.run)
    network = network.paced_for(*request.run.against_steps)
    if request.seconds is None:
        network = network.paced_for("a run without --seconds lasts for people, until Ctrl-C")
    check_ranges(request)
    service = service_of(request, network)
    for pair in service.pairs:
        check_light(service.link.protocol, pair, network.parts)
    protocol = service.link.protocol
    felt = reduce(or_, (felt_by(protocol, pair, network.parts) for pair in service.pairs))
    check_schedule(request.eve, service.pairs[0], network)
    if request.eve.eve is not None:
        felt |= everything([eavesdropping.EVE])
    return request, checked_settings(protocol, felt, network)


def service_of(request: KeysRequest, network: NetworkDescription) -> KeyService:
    """Return what key managers are to do; raise BadInput for what they cannot."""
    service = key_service(request.keys, network.hosts)
    assert service is not None  # there is a pair
    return service


def run(request: KeysRequest, signals: Signals, console: Console) -> int:
    request, description = checked(request)
    require_free(description.topo)
    folder = begin_folder(request.run.runs, NAME)
    service = service_of(request, description)
    path = eavesdropping.tapped_path(service.link.protocol, service.pairs[0], "", description)
    eve = ScheduledEavesdropper(request.eve, *path, folder)
    context = RunContext(eve.with_policy(description), request.run, folder, signals, console)
    hosts = list(dict.fromkeys(host for pair in service.pairs for host in pair))
    job = KeysJob()
    facts = known_facts(context, NAME, hosts, job, request)
    with ending(folder, facts, result.complete, context.options.report) as ended:
        with (
            running_network(context, facts) as network,
            NetworkWaits(network.runtime.time) as waits,
        ):
            waits.hold()
            managers = start_key_managers(network, service)
            introduce(console, managers)
            noted = time_series_of(network, managers.programs, console)
            job.time_series = noted.all
            watch(network, noted, eve, waits, request.seconds)
            job.asking = summary = time_series.summary(noted.all, noted.now_s)
        facts.delivered = summary.keys > 0
    result.show(console, facts, folder, ended.report)
    return 0 if facts.delivered else 1


def time_series_of(
    network: Network, programs: Mapping[str, Program], console: Console
) -> TimeSeries:
    """Return what takes down the words of programs of hosts, and shows them."""
    runtime = network.runtime
    return TimeSeries(programs, runtime.time, partial(show, console), runtime.clocks_ahead_s())


def watch(
    network: Network,
    noted: TimeSeries,
    eve: ScheduledEavesdropper,
    waits: NetworkWaits,
    seconds: float | None,
) -> None:
    """Gather what happens until the time is over, or somebody ends a run that has no end."""
    try:
        while seconds is None or noted.now_s < seconds:
            network.check()
            noted.gather()
            eve.look(network, noted)
            due_s = min(eve.due_s, math.inf if seconds is None else seconds)
            waits.pass_until(noted.stepped_ns(due_s))
            time.sleep(POLL_S)
    except Interrupted:
        if seconds is not None:
            raise
    finally:
        noted.finish()


def introduce(console: Console, managers: KeyManagers) -> None:
    for host, url in managers.urls.items():
        console.print(f"{host}: {url}/api/v1/keys/..., as {application_name(host)}")
    console.print(f"certificates: {managers.authority.parent}", soft_wrap=True)


def show(console: Console, moment: Moment) -> None:
    if not isinstance(moment, SessionMoment) or moment.opened:
        console.print(time_series.words(moment), soft_wrap=True, markup=False)
