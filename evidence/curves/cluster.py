"""Points measured by Dask: in processes of this machine, or on an existing cluster.

The local processes speak TLS with a key made for this run alone, on the loopback: nobody else
on the machine can give them work.
"""

import logging
import queue
import signal
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

import dask
from distributed import Client, Future, LocalCluster, Security

from evidence.curves.catalogue import measure
from evidence.curves.experiment import Experiment, SweepError
from evidence.curves.parameters import Values
from evidence.curves.scratch import scratch_folder
from qmn.timeouts import CLUSTER_TIMEOUT_S, NO_WORKER_TIMEOUT_S, SWEEP_POLL_S
from topologies.system.processes.signals import Signals

HTTP_ADDRESS = "127.0.0.1:0"  # any free port: the scheduler insists on serving its state there
LOG_LEVEL = 50  # critical: what concerns the user is raised

Measured = dict[str, tuple[float, float]]
Task = Callable[[str, Values, int], Measured]  # of a name, values and a seed


@contextmanager
def local_client(workers: int) -> Iterator[Client]:
    """Start worker processes here; they end with this context."""
    with (
        scratch_folder() as folder,
        # On a busy machine a living worker can be silent for minutes; a dead one closes its socket.
        dask.config.set({"distributed.scheduler.worker-ttl": None}),
        LocalCluster(
            n_workers=workers,
            threads_per_worker=1,
            host="127.0.0.1",
            dashboard_address=HTTP_ADDRESS,
            scheduler_kwargs={"dashboard": False},
            security=Security.temporary(),
            local_directory=folder,
            memory_limit=0,
            silence_logs=LOG_LEVEL,
        ) as cluster,
        Client(cluster) as client,
    ):
        client.run(ignore_interrupts)
        yield client


def ignore_interrupts() -> None:
    """Let a worker ignore Ctrl-C and its like, which a terminal sends to all: we end it."""
    for number in Signals.OF_TERMINAL:
        signal.signal(number, signal.SIG_IGN)


@contextmanager
def remote_client(scheduler: str) -> Iterator[Client]:
    """Connect to the scheduler of a cluster, such as tcp://10.0.0.1:8786."""
    logging.getLogger("distributed").setLevel(LOG_LEVEL)
    try:
        client = Client(scheduler, timeout=CLUSTER_TIMEOUT_S)
    except (OSError, ValueError) as error:
        raise SweepError(
            f"no Dask scheduler answers at {scheduler}: start `dask scheduler` there, or leave "
            "--scheduler out"
        ) from error
    with client:
        yield client


def measured(
    client: Client,
    experiment: Experiment,
    points: Sequence[Values],
    seed: int,
    check: Callable[[], None],
    measure: Task = measure,
) -> Iterator[tuple[Values, Measured]]:
    """Yield points as workers `measure` them; `check` is called often and may raise."""
    done: queue.SimpleQueue[Future[Measured]] = queue.SimpleQueue()
    name = experiment.name
    futures = {client.submit(measure, name, values, seed, pure=False): values for values in points}
    try:
        for future in futures:
            future.add_done_callback(done.put)
        workers = _Workers(client)
        left = len(futures)
        while left:
            check()
            try:
                future = done.get(timeout=SWEEP_POLL_S)
            except queue.Empty:
                workers.require_some()
                continue
            workers.seen()
            left -= 1
            values = futures[future]
            yield values, _result(future, experiment.place(values))
    finally:
        client.cancel(list(futures), force=True)


def _result(future: Future[Measured], place: str) -> Measured:
    if future.status == "finished":
        result: Measured = future.result()
        return result
    if future.status != "error":
        raise SweepError("the Dask scheduler has gone; start it and run the same command again")
    error = future.exception()
    if isinstance(error, SweepError):
        raise error
    if isinstance(error, (ModuleNotFoundError, RuntimeError)):  # Dask wraps the first in the second
        raise SweepError(
            "the Dask cluster cannot load qmn: start its scheduler and its workers in this folder, "
            "with this environment"
        ) from error
    raise SweepError(f"{place} failed: {type(error).__name__}: {error}") from error


class _Workers:
    def __init__(self, client: Client) -> None:
        self._client = client
        self.seen()

    def seen(self) -> None:
        self._seen_s = time.monotonic()

    def require_some(self) -> None:
        """Raise SweepError if there has been no worker for NO_WORKER_TIMEOUT_S."""
        if self._client.scheduler_info()["workers"]:
            self.seen()
        elif time.monotonic() - self._seen_s > NO_WORKER_TIMEOUT_S:
            raise SweepError(
                f"the Dask scheduler has had no worker for {NO_WORKER_TIMEOUT_S:g} s: "
                "start `dask worker` for it"
            )
