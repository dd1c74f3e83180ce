"""The runner of every job: starts a network, has two hosts use a service, reports, cleans up."""

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path
from pkgutil import resolve_name

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from hosts.middleware.session.options import SessionOptions
from programs.network_waits import NetworkWaits
from qmn.jobs import eavesdropping
from qmn.jobs.obstacle import lost_light
from qmn.jobs.run_context import RunContext, ending, known_facts, running_network
from qmn.jobs.transfer import TransferError, follow
from qmn.options import BadInput
from qmn.requests.request import Request
from qmn.requests.service_verbs import verb_of
from qmn.results import result
from qmn.results.run_result import RunResult
from qmn.timeouts import START_TIMEOUT_S
from topologies.networks.network import Network
from topologies.system.machines.machine import Machine
from topologies.system.processes.programs import NetworkError, Program, python, stop_all
from wire.network_time import NetworkTime, SteppedTime
from wire.results.figures import Figures, KeyProgress
from wire.results.run_result import Message, ServiceJob
from wire.results.time_series import Line, figures

Start = Callable[[str, str, Sequence[str]], Program]  # on a host, in a role, with words


@dataclass(frozen=True)
class Job:
    service: str
    options: SessionOptions  # what the opener asks for, checked
    opener: str
    acceptor: str
    others: tuple[str, ...] = field(default=(), kw_only=True)  # hosts that wait, too
    request: Request  # what was asked, checked
    announcement: str  # printed when it begins
    unit: str  # what it is about, as people call it
    total: int  # of these
    done: Callable[[Figures], int]  # how many of them the opener has reported
    rate: Callable[[Figures], float] | None = None  # of them in a second, if that is shown
    file: Path | None = None  # of bytes to send, for a service that carries some
    eve: eavesdropping.Attack | None = None  # None: she does nothing
    hand_out: Path | None = None  # a folder for keys, taken out of both ends' stores

    @property
    def result(self) -> ServiceJob:
        if self.file is None:
            return ServiceJob()
        return ServiceJob(message=Message(str(self.file), self.file.stat().st_size))


def run(job: Job, context: RunContext) -> RunResult:
    folder, console = context.folder, context.console
    hosts, report = (job.opener, job.acceptor, *job.others), job.result
    facts = known_facts(context, job.service, hosts, report, job.request)
    with ending(folder, facts, result.complete, context.options.report) as ended:
        use_network(job, context, facts, report)
    result.show(console, facts, folder, ended.report)
    return facts


def use_network(job: Job, context: RunContext, facts: RunResult, job_result: ServiceJob) -> None:
    """Start the network, do the job, and add to the facts, and to what is kept of the job."""
    with running_network(context, facts, partial(_require_keys_here, job)) as network:
        context.console.print(job.announcement)
        perform(job, network, context.folder, context.console, job_result)
        facts.delivered = True


def perform(
    job: Job,
    network: Network,
    folder: Path,
    console: Console,
    job_result: ServiceJob,
    label: str = "",
) -> None:
    """Do the job on a network that runs; the logs of its programs begin with the label."""
    with (
        eavesdropping.eavesdropping(network, job.eve, job_result, label),
        handing_out(network, job, job_result) as take,
        _progress_bar(console, job, job_result, take) as progress,
        lost_light(network, console) as lost,
        _programs(network, job, label) as start,
    ):
        _use(network, job, start, (folder, job_result), progress, lost.look)


def _require_keys_here(job: Job, places: Mapping[str, Machine]) -> None:
    """Raise BadInput if keys are to be taken out of a store on another machine."""
    for host in (job.opener, job.acceptor):
        if job.hand_out is not None and host in places:
            raise BadInput(
                f"--hand-out {job.hand_out}: the keys of {host} are on {places[host].name}; place "
                "it on m1, or take --keys DIR, which has them at the end"
            )


@contextmanager
def _programs(network: Network, job: Job, label: str) -> Iterator[Start]:
    """Give what starts a program of the job on a host; end those that a failure leaves."""
    started: list[Program] = []

    def start(host: str, role: str, words: Sequence[str]) -> Program:
        command = [python(), "-m", "hosts.applications.service", "--stack"]
        command += [network.runtime.socket(host), job.service, str(job.options.port), *words]
        started.append(network.run_on(host, f"{label}{role}", command))
        return started[-1]

    try:
        yield start
    except (TransferError, NetworkError):
        network.explain()
        raise
    finally:
        stop_all(started)


def _use(
    network: Network,
    job: Job,
    start: Start,
    left: tuple[Path, ServiceJob],
    progress: Callable[[Line], None],
    look: Callable[[], None],
) -> None:
    """Start both ends' applications, and follow them to their last words.

    They leave bytes in a folder, and their figures in the job.
    """
    folder, report = left
    options = asdict(job.options)
    host = options.pop("host")
    del options["port"]
    address = [host, "--options", json.dumps(options)]
    output = ["--output", str(folder / result.RECEIVED)] if job.file else []
    source = ["--file", str(job.file), *_time(network.runtime.time)] if job.file else []
    with NetworkWaits(network.runtime.time) as waits:
        waits.hold()  # light that is watched already would go on while programs start
        acceptor = start(job.acceptor, "asked", output)
        others = [start(host, f"asked-{host}", output) for host in job.others]
        for waiting in (acceptor, *others):
            waiting.wait_for("listening", START_TIMEOUT_S, network.check)
        asking = start(job.opener, "asking", [*address, *source])
    progress(follow(network, asking, progress, look))
    report.asked = figures(follow(network, acceptor, lambda _line: None, look))
    for waiting in others:
        follow(network, waiting, lambda _line: None, look)


def _time(network_time: NetworkTime) -> list[str]:
    if isinstance(network_time, SteppedTime):
        return ["--time-folder", network_time.folder]
    return ["--time-scale", str(network_time.scale)]


@contextmanager
def handing_out(network: Network, job: Job, job_result: ServiceJob) -> Iterator[Callable[[], None]]:
    """Have keys of both ends taken whenever that is called, and once more at the end."""
    if job.hand_out is None:
        yield lambda: None
        return
    ends = job.opener, job.acceptor
    key_handout = resolve_name(verb_of(job.service).hand_out)
    stores = [network.runtime.key_folder(host) for host in ends]
    with key_handout(job.hand_out, ends, stores) as handout:
        yield handout.take
    if isinstance(job_result.asking, KeyProgress):
        job_result.asking.handed_out = handout.count


@contextmanager
def _progress_bar(
    console: Console, job: Job, job_result: ServiceJob, take: Callable[[], None]
) -> Iterator[Callable[[Line], None]]:
    """Show how far the opener is; what it says is also kept, and keys are taken."""
    rates = [TextColumn("{task.fields[rate]:,.0f} " + f"{job.unit}/s")] if job.rate else []
    with Progress(
        *(TextColumn(job.unit), BarColumn(), MofNCompleteColumn(), *rates, TimeRemainingColumn()),
        console=console,
    ) as bar:
        task = bar.add_task(job.unit, total=job.total, rate=0.0)

        def note(line: Line) -> None:
            job_result.asking = latest = figures(line)
            take()
            rate = job.rate(latest) if job.rate else 0.0
            bar.update(task, completed=min(job.done(latest), job.total), rate=rate)

        yield note
