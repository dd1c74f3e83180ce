"""The cost of stepped time: of one leap, and of a whole run beside the same one at the wall's pace.

Both kinds of run take turns, so that a machine that gets slower slows both alike.
"""

import os
import select
import shutil
import statistics
import subprocess
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

from rich.console import Console

from qmn.jobs import runner, superdense
from qmn.jobs.transfer import TransferError
from qmn.network.time_scale import PACED, STEPPED
from qmn.requests.run_options import RunOptions
from qmn.requests.superdense import superdense_request
from topologies.networks.network import Signals
from topologies.system.processes.programs import ROOT, NetworkError, python
from wire.config import GateConfig
from wire.network_time import GateClient, SteppedTime

MESSAGE_BYTES = 6_000_000
ROUNDS = 3
LEAPS = {10: 2_000, 1024: 200}  # by the programs
# Programs that wait in eight threads, as those with gRPC do.
IDLE = """
import os, sys, threading
first = os.getpid()
for _ in range(int(sys.argv[1]) - 1):
    if not os.fork():
        break
for _ in range(7):
    threading.Thread(target=threading.Event().wait, daemon=True).start()
if os.getpid() == first:
    print(flush=True)
sys.stdin.read()
"""


def stepped_benchmarks(folder: Path, signals: Signals) -> Iterator[tuple[str, str]]:
    """Yield name and text of each figure; raise NetworkError if a run fails."""
    for programs, leaps in LEAPS.items():
        us = leap_us(programs, leaps)
        yield f"leap of stepped time, {programs:,} idle programs", f"{us:,.0f} us"
    file = folder / "message"
    file.write_bytes(os.urandom(MESSAGE_BYTES))
    shares = []
    for _ in range(ROUNDS):
        seconds = {}
        for kind in (PACED, STEPPED):
            signals.check()
            seconds[kind] = run_s(file, kind, RunOptions(runs=folder / "stepped"), signals)
        shares.append(seconds[STEPPED] / seconds[PACED])
    share = f"{statistics.median(shares):.2f} ({min(shares):.2f} to {max(shares):.2f})"
    yield "qmn run sdc, framed, 6 MB, stepped to paced", share


def run_s(file: Path, kind: str, run: RunOptions, signals: Signals) -> float:
    """Return how long a whole run takes by the wall, with its network's start and end."""
    request = replace(superdense_request(file=file, time=kind), run=run)
    began_s = time.perf_counter()
    try:
        runner.run(*superdense.begun(request, signals, Console(quiet=True)))
    except TransferError as error:
        raise NetworkError(f"superdense coding failed: {error}") from error
    passed_s = time.perf_counter() - began_s
    shutil.rmtree(run.runs)
    return passed_s


def leap_us(programs: int, leaps: int) -> float:
    """Return what a leap takes of the wall while a number of programs are idle."""
    command = [python(), "-c", IDLE, str(programs)]
    with (
        stepping() as stepped,
        subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as idle,
        closing(GateClient(stepped)) as client,
    ):
        assert idle.stdout is not None
        idle.stdout.readline()
        began_s = time.perf_counter()
        for number in range(leaps):
            client.wait_for(number + 1)
            select.select([client], [], [])
            client.take_notice()
        return (time.perf_counter() - began_s) / leaps * 1e6


@contextmanager
def stepping() -> Iterator[SteppedTime]:
    """Run a gate, which looks at all that runs in this process's namespace."""
    with TemporaryDirectory(dir="/tmp") as folder:  # sockets need a short path
        config = Path(folder, "gate.json")
        GateConfig(f"{folder}/leaps", time_folder=folder).write(config)
        command = [python(), "-m", "gate", "--config", str(config)]
        with subprocess.Popen(command, stdout=subprocess.PIPE, cwd=ROOT) as gate:
            try:
                assert gate.stdout is not None
                if gate.stdout.readline() != b"ready\n":
                    raise NetworkError("the gate of stepped time does not start")
                yield SteppedTime(folder=folder)
            finally:
                gate.terminate()
                gate.communicate()
