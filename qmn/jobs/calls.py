"""A job by calls of this process to the stacks of its hosts, without programs on them."""

from collections.abc import Callable
from dataclasses import asdict

from hosts.client import blocking_session
from hosts.stack_socket import QuantumSocketError
from qmn.jobs.runner import Job
from qmn.jobs.transfer import Patience, TransferError, no_progress, with_elements
from qmn.timeouts import STALL_TIMEOUT_S
from topologies.networks.network import Network
from topologies.system.processes.programs import NetworkError
from wire.results.run_result import ServiceJob
from wire.results.time_series import Line, figures


def call(network: Network, job: Job, result: ServiceJob, take: Callable[[], None]) -> None:
    """Have two hosts use a service; keep the figures of both, and call `take` at each result.

    Raise TransferError if it fails, NetworkError if the network does.
    """
    options = asdict(job.options)
    del options["host"], options["port"]
    ends = job.opener, job.acceptor, *job.others
    stacks, time_ = network.runtime.socket, network.runtime.time
    progress = Progress(network, result, take)
    try:
        with blocking_session(
            stacks, job.service, ends, job.options.port, time_, limit_s=None, **options
        ) as session:
            session.results(progress.note, progress.look)
            asking, acceptor, *_others = session.end(progress.look)
    except QuantumSocketError as error:
        network.explain()
        text = with_elements(network, str(error))
        raise TransferError(text, error.reason.name) from error
    progress.note(asking)
    result.asked = figures(acceptor)


class Progress:
    """The latest report of the opener, and its time."""

    def __init__(self, network: Network, result: ServiceJob, take: Callable[[], None]) -> None:
        self._network, self._kept, self._take = network, result, take
        self._latest: Line = {}
        self._patience = Patience(network.runtime.time, STALL_TIMEOUT_S)

    def note(self, line: Line) -> None:
        self._latest = line
        self._patience.renew()
        self._kept.asking = figures(line)
        self._take()

    def look(self) -> None:
        """Raise NetworkError if a program has died, or nothing was reported for too long."""
        self._network.check()
        if self._patience.is_over:
            self._network.explain()
            raise NetworkError(no_progress({"the session": self._latest}, self._patience.wall_s))
