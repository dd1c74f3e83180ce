"""A job on a network that stands, and goes on standing when the job has ended."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from rich.console import Console

from qmn.jobs import calls, counted_service, eavesdropping, runner, superdense
from qmn.jobs.adjustment import WORDS, behind
from qmn.jobs.run_context import RunContext, known_facts, note_light
from qmn.jobs.transfer import TransferError
from qmn.network.description import NetworkDescription
from qmn.network.options import NetworkOptions
from qmn.options import BadInput, from_keywords
from qmn.requests.of_job import OF_NETWORK, JobRequest, request_of
from qmn.requests.request import Request
from qmn.requests.run_options import RunOptions
from qmn.requests.service import ServiceRequest, has_option
from qmn.requests.service_verbs import verb_of
from qmn.results.pace_row import note_pace
from qmn.results.result import network_facts, note_outcome
from qmn.results.run_result import RunResult
from qmn.running.dispatcher_calls import status
from topologies.networks.network import Network, Signals
from wire.controller_lines import NewFacts
from wire.registered import STANDING_JOBS, Registry
from wire.results.run_result import Job

STANDING = Registry[Any](STANDING_JOBS, callable, {})  # jobs that are no services
NOT_TAPPED = "this network has eve on its fibre: say eve=0 if she is to do nothing"


@dataclass(frozen=True)
class Made:
    """A network as it was made: by its options, and by those of the job that it is for."""

    description: NetworkDescription  # without the policy that these options need
    fixed: Mapping[str, Any]  # of `_fixed_by`


@dataclass(frozen=True)
class NetworkFor:
    """A network to be started for a job, with the policy that the job needs."""

    made: Made
    request: JobRequest

    def description(self, folder: Path) -> NetworkDescription:
        """Return what is to be started; its policy is written into the folder."""
        if isinstance(self.request, ServiceRequest):
            return counted_service.with_policy(self.request, self.made.description, folder)
        return self.made.description


def network_for(job: str, options: Mapping[str, Any]) -> NetworkFor:
    """Return the network that a job with these options needs; raise BadInput or BadTopology."""
    request = request_of(job, options)
    if isinstance(request, ServiceRequest):
        request, network = counted_service.checked(request)
    else:
        request, network = superdense.checked(request)
    return NetworkFor(Made(network, _fixed_by(request, network)), request)


@dataclass(frozen=True)
class Planned:
    """A job that can be done: what its result keeps of it, and what does it."""

    service: str
    hosts: Sequence[str]
    result: Job
    request: Request
    perform: Callable[[], None]


def run(
    network: Network,
    made: Made,
    job: str,
    options: Mapping[str, Any],
    number: int,
    record: NewFacts,
) -> RunResult:
    """Do a job on the network; raise BadInput for one that needs another network.

    Light that is too noisy is an outcome: not delivered, with an `error`. Logs of its programs
    begin with its number, which its folder has, too.
    """
    of_job = {name: value for name, value in options.items() if name not in OF_NETWORK}
    of_network = {name: options[name] for name in options.keys() & OF_NETWORK}
    folder = network.runtime.logs / f"{number}-{job}"
    if job in STANDING:
        _require_same(made, job, of_network)
        planned = STANDING[job](network, made.description, of_job, folder)
    else:
        request = request_of(job, of_job)
        _require_same(made, job, of_network)
        request = _fitted(made, job, replace(request, network=made.description.options))
        planned = _planned(network, made.description, request, folder)
    folder.mkdir(exist_ok=True)
    context = RunContext(made.description, RunOptions(), folder, Signals(), Console(quiet=True))
    facts = known_facts(context, planned.service, planned.hosts, planned.result, planned.request)
    note_pace(facts, made.description.pace)
    facts.network = network_facts(network)
    before = status(network)
    record.read()  # of jobs before
    _perform(planned, facts)
    note_light(facts, network, before)
    note_outcome(facts, folder, record.read())
    facts.write(folder)
    return facts


def _perform(planned: Planned, facts: RunResult) -> None:
    try:
        planned.perform()
        facts.delivered = True
    except TransferError as error:
        if not error.is_outcome:
            raise
        facts.error = str(error)


def _planned(
    network: Network, description: NetworkDescription, request: JobRequest, folder: Path
) -> Planned:
    """Return the job of a service; its message may be written into the folder."""
    folder.mkdir(exist_ok=True)
    if isinstance(request, ServiceRequest):
        task = counted_service.job(request, description)
    else:
        task = superdense.job(request, superdense.message_file(request, folder))
    result, label = task.result, f"{folder.name}-"

    def perform() -> None:
        if task.file is not None:
            runner.perform(task, network, folder, Console(quiet=True), result, label)
            return
        with (
            eavesdropping.eavesdropping(network, task.eve, result, label),
            runner.handing_out(network, task, result) as take,
        ):
            calls.call(network, task, result, take)

    hosts = task.opener, task.acceptor, *task.others
    return Planned(task.service, hosts, result, task.request, perform)


def _require_same(made: Made, job: str, changes: Mapping[str, Any]) -> None:
    """Raise BadInput for an option of networks that has another value in this one."""
    options = made.description.options
    named = {name: value for name, value in changes.items() if name != "topology"}
    topology = changes.get("topology", options.topology)
    requested = from_keywords(NetworkOptions, named, topology=topology)
    for name in sorted(changes):
        value, stands = getattr(requested, name), getattr(options, name)
        if name in WORDS:  # behind the parts that a swap gives all switches, and its like
            value = behind(stands, value)
        if value != stands:
            error = _fixed_at_start(job, name, value)
            raise BadInput(f"{error}; this one has {stands!r}")


def _fitted(made: Made, job: str, request: JobRequest) -> JobRequest:
    """Return the request as the network has it; raise BadInput if it needs another one."""
    network = made.description
    if not isinstance(request, ServiceRequest):
        return superdense.fitted(request, network)[0]
    if request.eve is not None and made.fixed["eve"] is None:
        raise _fixed_at_start(job, "eve", request.eve)
    request, needed, _felt = counted_service.fitted(request, network)
    if needed.options.device != network.options.device:
        text = f"{request.service} needs {needed.options.device[-1]}"
        raise BadInput(f"{text}: start_for({job!r}, protocol={request.service!r}) has it")
    for name, value in _fixed_by(request, network).items():
        if value == made.fixed[name] or not has_option(verb_of(request.service), name):
            continue
        if name == "eve" and value is None:
            raise BadInput(NOT_TAPPED)
        raise _fixed_at_start(job, name, getattr(request, name))
    return request


def _fixed_at_start(job: str, name: str, value: object) -> BadInput:
    option = f"{name}={value!r}"
    return BadInput(
        f"{option} is fixed when a network starts: start_for({job!r}, {option}) starts one for it"
    )


def _fixed_by(request: JobRequest, network: NetworkDescription) -> dict[str, Any]:
    """Return what options of a job make part of a network's policy: whose light eve sees, a plan.

    None of it: the policy needs nothing.
    """
    if not isinstance(request, ServiceRequest):
        return dict.fromkeys(("eve", "schedule", "purify"))
    path = None
    if request.eve is not None:
        ends = request.sender, request.receiver
        path = eavesdropping.tapped_path(request.service, ends, request.options.source, network)
    return {"eve": path, "schedule": request.schedule, "purify": request.purify}


def made_as(description: NetworkDescription) -> Made:
    return Made(description, dict.fromkeys(("eve", "schedule", "purify")))
