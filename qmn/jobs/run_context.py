"""The context of a run of any kind: its folder, its network, its facts, its end."""

import os
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from rich.console import Console

from qmn.jobs.transfer import TransferError
from qmn.machines.options import machine_facts, machines_of
from qmn.network.custom_topology import BadTopology
from qmn.network.description import NetworkDescription
from qmn.network.options import settings
from qmn.options import BadInput
from qmn.printable_text import console_of_output
from qmn.requests.request import Request
from qmn.requests.run_options import RunOptions
from qmn.results.pace_row import note_pace, time_text
from qmn.results.result import network_facts, note_files
from qmn.results.run_folder import give_to_invoker, given_at_the_end, lasting
from qmn.results.run_result import RunResult
from qmn.results.sentences import of_eve
from qmn.results.timeline import timeline_of_run
from qmn.running.dispatcher_calls import status
from qmn.running.metrics_targets import announce
from qmn.running.network import announce_network
from topologies.links.causality import worst
from topologies.links.slow_copper import slow_metadata
from topologies.networks.network import Interrupted, Network, Signals
from topologies.system.machines.machine import Machine
from topologies.system.processes.outputs import LostOutput
from topologies.system.processes.programs import NetworkError
from topologies.system.processes.signals import interrupted_words
from views.live.beside import live_view
from views.live.pages import Pages
from views.report.beside import Draw, report_beside
from wire.dispatcher_pb2 import StatusReply
from wire.results.run_result import Approximated, EarlyNews, Job

Work = Callable[[Signals, Console], int]
Prepare = Callable[[Mapping[str, Machine]], None]
Complete = Callable[[RunResult, Path], None]
NO_LIGHT = StatusReply()


def guarded(work: Work) -> int:
    """Do the work; turn every fault into one line and an exit status."""
    try:
        with Signals() as signals:
            return work(signals, console_of_output())
    except (BadInput, BadTopology, NetworkError, TransferError) as error:
        tell(str(error), error)
        return 1
    except Interrupted as error:
        print(f"qmn: {interrupted_words(error)}", file=sys.stderr)
        return error.status


def tell(words: str, error: Exception) -> None:
    """Print what ended the work, and what is left of it to look at."""
    print(f"qmn: {words}", *getattr(error, "__notes__", ()), sep="\n", file=sys.stderr)


@dataclass(frozen=True)
class RunContext:
    """A run that begins: its network, what it leaves and where, and who follows it."""

    network: NetworkDescription
    options: RunOptions
    folder: Path
    signals: Signals
    console: Console


def known_facts(
    context: RunContext, service: str, hosts: Sequence[str], job: Job, request: Request
) -> RunResult:
    """Return the initial result, with no outcome yet."""
    options, run = context.network.options, context.options
    return RunResult(
        service=service,
        hosts=list(hosts),
        topology=options.topology,
        mode=os.environ.get("QMN_MODE", "native"),
        controller=options.controller,
        seed=options.seed,
        parameters=replace(request, network=options),
        every_fiber=context.network.every_fiber,
        devices=dict(context.network.stated_devices),
        unused_settings=list(context.network.unused_settings),
        events=run.events,
        backend=options.backend,
        job=job,
    )


@contextmanager
def running_network(
    context: RunContext, facts: RunResult, prepare: Prepare = lambda _places: None
) -> Iterator[Network]:
    """Run a network with its captures, on the machines that are asked for; add to the facts.

    `prepare` is called before the start, with the machines of hosts that are not on this one; it
    may raise.
    """
    hosts, check = context.network.hosts, context.signals.check
    with machines_of(context.options, hosts, context.folder, check) as places:
        prepare(places)
        with _running(context, facts, places) as network:
            yield network


@contextmanager
def _running(
    context: RunContext, facts: RunResult, places: dict[str, Machine]
) -> Iterator[Network]:
    description, run, console = context.network, context.options, context.console
    _announce_start(context, facts)
    runtime = settings(
        description.options,
        context.folder,
        description.pace,
        record=run.record,
        qasm=run.qasm,
        events=run.events,
    )
    runtime.places = places
    runtime.watched = run.shown or Pages.of_command() is not None
    with (
        given_at_the_end(description.options.keys),
        Network(
            description.build,
            runtime,
            context.signals,
            partial(_say_cause, console),
            partial(console.print, soft_wrap=True),
            run.packet_bytes,
        ) as network,
    ):
        _note_network(context, facts, network)
        if run.classical_mbps is not None:
            for host in description.hosts:
                slow_metadata(network.host(host), run.classical_mbps, description.pace.scale)
        say = partial(console.print, soft_wrap=True)
        with live_view(run.live, context.folder, say, for_all=run.live_for_all):
            try:
                yield network
            except TransferError:  # the network lasts: a service has failed, or given no key
                with suppress(NetworkError):  # which would hide the cause
                    note_light(facts, network)
                raise
        note_light(facts, network)
    note_files(facts, network)


def _say_cause(console: Console, cause: Exception) -> None:
    """Print why a network ends; the end of the run prints the outcome of a job."""
    if not (isinstance(cause, TransferError) and cause.is_outcome):
        console.print(f"ending: {cause}", soft_wrap=True)


def _announce_start(context: RunContext, facts: RunResult) -> None:
    description, console = context.network, context.console
    options, pace = description.options, description.pace
    note_pace(facts, pace)
    console.print(f"starting the network ({options.controller}, seed {options.seed}) ...")
    if pace.reason:
        console.print(f"time: {time_text(facts)}", soft_wrap=True)
    if unused := description.unused_settings:
        console.print(f"not used by {facts.service}: {', '.join(unused)}", soft_wrap=True)


def _note_network(context: RunContext, facts: RunResult, network: Network) -> None:
    """Add what has started to the facts, and print the addresses of its telemetry."""
    options, runtime, console = context.network.options, network.runtime, context.console
    if runtime.places:
        facts.machines = machine_facts(runtime)
    facts.network = network_facts(network)
    announce_network(runtime, facts)
    facts.backend = status(network).backend
    if options.metrics:
        facts.metrics = urls = announce(runtime.metrics_addresses, context.folder)
        for program, url in urls.items():
            console.print(f"metrics of {program}: {url}", soft_wrap=True)
    if options.gnmi:
        facts.gnmi = dict(runtime.gnmi_addresses)
        for switch, address in runtime.gnmi_addresses.items():
            console.print(f"gNMI of {switch}: {address}", soft_wrap=True)
    facts.captures = [str(file) for file in network.captured]


def note_light(facts: RunResult, network: Network, before: StatusReply = NO_LIGHT) -> None:
    """Add what light there was since `before`, and how exactly it was simulated so far."""
    reached = status(network)
    facts.exact = reached.exact
    facts.approximations = [Approximated(each.name, each.most) for each in reached.approximations]
    facts.pairs_made = reached.pairs_created - before.pairs_created
    facts.photons_lost = reached.photons_lost - before.photons_lost
    facts.photons_lost_waiting = reached.photons_lost_waiting - before.photons_lost_waiting
    facts.drawn_for = list(reached.drawn_for)
    early = worst(network.runtime)
    facts.acausal = EarlyNews(*early) if early else None


@dataclass
class Ended:
    """Facts of a run that has ended which its result does not keep."""

    report: str = ""  # file, or how to make it


@contextmanager
def ending(
    folder: Path, facts: RunResult, complete: Complete, report: bool = True
) -> Iterator[Ended]:
    """Leave timeline, facts and report behind, whatever happens inside.

    The end of a run names its report; a network that did not start has none.
    """
    ended = Ended()
    fault: Exception | None = None
    with (
        lasting(folder, (TransferError,)),
        report_beside() if report else nullcontext(_put_off) as draw,
    ):
        try:
            yield ended
        except (NetworkError, TransferError, Interrupted, LostOutput, OSError) as error:
            fault = error
            facts.error = str(error)
            raise
        finally:
            if folder.is_dir():
                facts.timeline = timeline_of_run(folder)
                complete(facts, folder)
                ended.report = _report(folder, facts, draw)
                if fault is not None and facts.network is not None:
                    notes = of_eve(facts), f"report to look at: {ended.report}"
                    fault.add_note("\n".join(filter(None, notes)))
                give_to_invoker(folder)


def _put_off(folder: Path) -> str:
    return f"`qmn report {folder}` makes it"


def _report(folder: Path, facts: RunResult, draw: Draw) -> str:
    """Return the file of the report, or why there is none."""
    return draw(folder) if facts.network is not None else "not made: the network had not started"
