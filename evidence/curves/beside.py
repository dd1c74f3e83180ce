"""Points measured in networks beside each other, each network as on a machine of its own.

Here, as many at a time as there are processors, or by the workers of a Dask cluster.
"""

import json
import os
import subprocess
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from queue import Empty, SimpleQueue
from tempfile import TemporaryFile
from threading import Lock

from evidence.curves.cluster import Measured
from evidence.curves.experiment import SweepError
from evidence.curves.grid import Grid, Measurer, Row
from evidence.curves.parameters import Values
from evidence.curves.running import estimates
from evidence.curves.scratch import scratch_folder
from qmn.timeouts import SWEEP_POLL_S
from topologies.networks.requirements import require_root
from topologies.system.namespaces import in_own_namespaces
from topologies.system.processes.programs import ENVIRONMENT, NetworkError, cause, python

PROGRAM = "evidence.networks.point"


class Networks:
    """The networks that this process has running for points; `end` ends them all."""

    def __init__(self) -> None:
        self._running: set[subprocess.Popen[str]] = set()
        self._ended, self._lock = False, Lock()

    def measure(
        self, runs: Path, name: str, seed: int, points: Sequence[Values]
    ) -> Iterator[Measured]:
        """Measure points in a network of theirs; raise SweepError, also if it was ended."""
        request = {"name": name, "points": points, "seed": seed, "runs": str(runs.absolute())}
        with scratch_folder() as folder, TemporaryFile("w+") as complaints:
            environment = {**os.environ, **ENVIRONMENT, "TMPDIR": folder}
            with self._lock:
                if self._ended:
                    raise SweepError("the sweep has ended")
                process = subprocess.Popen(
                    in_own_namespaces([python(), "-P", "-m", PROGRAM]),
                    env=environment,
                    stdin=subprocess.PIPE,
                    stdout=subprocess.PIPE,
                    stderr=complaints,
                    text=True,
                    start_new_session=True,  # a Ctrl-C is ours to pass on
                )
                self._running.add(process)
            assert process.stdin is not None
            assert process.stdout is not None
            with process.stdin as stream:
                json.dump(request, stream)
            with process.stdout as lines:
                yield from map(json.loads, lines)
            process.wait()
            complaints.seek(0)
            text = complaints.read()
        with self._lock:
            self._running.remove(process)
        if process.returncode:
            raise SweepError(cause(text) or f"status {process.returncode}, without a word")

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
    (measured,) = Networks().measure(Path(runs), name, seed, [values])
    return measured


def in_networks(runs: Path, at_once: int, check: Callable[[], None]) -> Measurer:
    """Return a measurer of `at_once` networks at a time here; `check` may end it by raising."""

    def measurer(grid: Grid, points: Sequence[Values], seed: int) -> Iterator[Row]:
        networks, rows = Networks(), SimpleQueue[Row]()

        def measure(group: Sequence[Values]) -> None:
            for values, numbers in zip(
                group, networks.measure(runs, grid.experiment.name, seed, group), strict=True
            ):
                rows.put((values, estimates(numbers)))

        with ThreadPoolExecutor(at_once, thread_name_prefix="network") as pool:
            groups = grid.experiment.groups(points, at_once)
            futures = [pool.submit(measure, group) for group in groups]
            try:
                yield from _as_they_come(rows, futures, check)
            finally:
                pool.shutdown(wait=False, cancel_futures=True)
                networks.end()

    return measurer


def _as_they_come(
    rows: "SimpleQueue[Row]", futures: Sequence[Future[None]], check: Callable[[], None]
) -> Iterator[Row]:
    """Yield rows until all is done; raise as soon as a network has failed."""
    while True:
        check()
        ended = [future for future in futures if future.done()]
        try:
            yield rows.get(timeout=0 if len(ended) == len(futures) else SWEEP_POLL_S)
        except Empty:
            for future in ended:
                future.result()
            if len(ended) == len(futures):
                return
