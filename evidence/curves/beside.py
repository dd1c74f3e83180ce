"""Points measured in networks beside each other, each as on a machine of its own.

Here, as many at a time as there are processors, or by the workers of a Dask cluster.
"""

import json
import os
import subprocess
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from functools import partial
from pathlib import Path
from threading import Lock

from evidence.curves.cluster import Measured
from evidence.curves.experiment import SweepError
from evidence.curves.grid import Grid, Measurer, Row
from evidence.curves.parameters import Values, point_seed
from evidence.curves.running import estimates
from evidence.curves.scratch import scratch_folder
from qmn.timeouts import SWEEP_POLL_S
from topologies.networks.network import require_root
from topologies.system.namespaces import in_own_namespaces
from topologies.system.processes.programs import ENVIRONMENT, NetworkError, cause, python

PROGRAM = "evidence.networks.point"


class Networks:
    """The networks that this process has running for points; `end` ends them all."""

    def __init__(self) -> None:
        self._running: set[subprocess.Popen[str]] = set()
        self._ended, self._lock = False, Lock()

    def measure(self, runs: Path, name: str, values: Values, seed: int) -> Measured:
        """Measure a point in a network of its own; raise SweepError, also if it was ended."""
        asked = {"name": name, "values": values, "seed": seed, "runs": str(runs.absolute())}
        with scratch_folder() as folder:  # goes also if the program cannot
            environment = {**os.environ, **ENVIRONMENT, "TMPDIR": folder}
            with self._lock:
                if self._ended:
                    raise SweepError("the sweep has ended")
                process = subprocess.Popen(
                    in_own_namespaces([python(), "-P", "-m", PROGRAM]),
                    env=environment,
                    stdin=subprocess.PIPE,
                    stdout=subprocess.PIPE,
                    stderr=subprocess.PIPE,
                    text=True,
                    start_new_session=True,  # a Ctrl-C is ours to pass on
                )
                self._running.add(process)
            output, complaints = process.communicate(json.dumps(asked))
        with self._lock:
            self._running.remove(process)
        if process.returncode:
            why = cause(complaints) or f"status {process.returncode}, without a word"
            raise SweepError(why)
        measured: Measured = json.loads(output)
        return measured

    def end(self) -> None:
        with self._lock:
            self._ended = True
            for process in self._running:
                process.kill()


def measure(runs: str, name: str, values: Values, seed: int) -> Measured:
    """Measure a point in a network of its own; this is what workers of a cluster are asked."""
    try:
        require_root()
    except NetworkError as error:
        raise SweepError(f"a worker of the Dask cluster cannot: {error}") from error
    return Networks().measure(Path(runs), name, values, point_seed(name, values, seed))


def in_networks(runs: Path, at_once: int, check: Callable[[], None]) -> Measurer:
    """Return a measurer of `count` points at a time here; `check` may end it by raising."""

    def measurer(grid: Grid, points: Sequence[Values], seed: int) -> Iterator[Row]:
        name, networks = grid.experiment.name, Networks()
        with ThreadPoolExecutor(at_once, thread_name_prefix="network") as pool:
            measure = partial(networks.measure, runs, name)
            seeds = [point_seed(name, values, seed) for values in points]
            asked = {
                pool.submit(measure, values, own_seed): values
                for values, own_seed in zip(points, seeds, strict=True)
            }
            try:
                yield from _as_they_come(asked, check)
            finally:
                pool.shutdown(wait=False, cancel_futures=True)
                networks.end()

    return measurer


def _as_they_come(
    asked: dict[Future[Measured], Values], check: Callable[[], None]
) -> Iterator[Row]:
    left = set(asked)
    while left:
        check()
        done, left = wait(left, SWEEP_POLL_S, FIRST_COMPLETED)
        for future in done:
            yield asked[future], estimates(future.result())
