"""The cost of captures, events and records: runs with them beside runs without.

And beside stim's batch sampler, which makes pairs without any network, in the same rounds.

Runs of all kinds take turns, in both orders, so that a machine that gets slower, or still has to
bring to the disk what the run before has written, slows all of them alike. Their source is so fast
that they wait for software, and not for light; stepped time would not count that.
"""

import os
import shutil
import statistics
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from rich.console import Console

from qmn.jobs import runner, superdense
from qmn.jobs.transfer import TransferError
from qmn.network.time_scale import PACED
from qmn.requests.run_options import RunOptions
from qmn.requests.superdense import superdense_request
from qmn.timeouts import RUN_TIMEOUT_S
from topologies.networks.network import Signals
from topologies.system.processes import commands
from topologies.system.processes.programs import (
    ROOT,
    NetworkError,
    callers_environment,
    python,
)
from wire.results.figures import SentFigures

MESSAGE_BYTES = 4 << 20
ROUNDS = 5
RATE_HZ = 1_000_000_000
NOTHING, EVERYTHING = "nothing written", "everything written"
KINDS = {
    NOTHING: RunOptions(captures="none", without=("events", "record")),
    "events alone": RunOptions(captures="none", without=("record",)),
    "captures alone": RunOptions(without=("events", "record")),
    "replay record alone": RunOptions(captures="none", without=("events",)),
    EVERYTHING: RunOptions(),
}
# As it comes, and with what qmn tells the C library of memory, which it is faster with, too.
SAMPLERS: dict[str, Callable[[], Mapping[str, str]]] = {
    "stim's batch sampler, no network": callers_environment,
    "  with qmn's settings of memory": lambda: os.environ,
}


@dataclass(frozen=True)
class Measured:
    pairs_per_s: float
    packets_missed: int = 0  # by its captures, which then had less to do


Round = dict[str, Measured]  # a run of each kind


def overhead_benchmarks(folder: Path, signals: Signals) -> Iterator[tuple[str, str]]:
    """Yield name and text for each kind of run; raise NetworkError if one fails."""
    file = folder / "message"
    file.write_bytes(os.urandom(MESSAGE_BYTES))
    rounds: list[Round] = []
    sampled: dict[str, list[float]] = {name: [] for name in SAMPLERS}
    for number in range(ROUNDS):
        measured: Round = {}
        for kind in order(number):
            signals.check()
            measured[kind] = measure(file, replace(KINDS[kind], runs=folder / "overhead"), signals)
        rounds.append(measured)
        for name, environment in SAMPLERS.items():
            sampled[name].append(sampled_pairs_per_s(environment()))
    yield from compared(rounds)
    for name, rates in sampled.items():
        yield from beside_sampler(name, rounds, rates)


def order(number: int) -> list[str]:
    """Return in which order the kinds have their turns in a round."""
    return list(KINDS)[:: -1 if number % 2 else 1]


def compared(rounds: list[Round]) -> Iterator[tuple[str, str]]:
    for kind in KINDS:
        rates = [each[kind].pairs_per_s for each in rounds]
        shares = [each[kind].pairs_per_s / each[NOTHING].pairs_per_s for each in rounds]
        share = f"{statistics.median(shares):.0%} ({min(shares):.0%} to {max(shares):.0%})"
        yield f"qmn run sdc, {kind}", f"{statistics.median(rates):,.0f} Bell pairs/s, {share}"
    missed = sum(run.packets_missed for each in rounds for run in each.values())
    yield "  packets not captured", f"{missed:,}"


def beside_sampler(
    name: str, rounds: list[Round], sampled: list[float]
) -> Iterator[tuple[str, str]]:
    yield name, f"{statistics.median(sampled):,.0f} Bell pairs/s"
    shares = [
        each[EVERYTHING].pairs_per_s / rate for each, rate in zip(rounds, sampled, strict=True)
    ]
    share = f"{statistics.median(shares):.2f} ({min(shares):.2f} to {max(shares):.2f})"
    yield f"  times that, {EVERYTHING}", share


def sampled_pairs_per_s(environment: Mapping[str, str]) -> float:
    """Return how many pairs a second stim's batch sampler makes in a process of its own."""
    command = [python(), "-m", "evidence.bench.batch_sampler"]
    variables = {**environment, "PYTHONPATH": str(ROOT)}
    return float(commands.run(*command, timeout_s=RUN_TIMEOUT_S, environment=variables))


def measure(file: Path, run: RunOptions, signals: Signals) -> Measured:
    """Send the file in one run, timed from the first byte to the verified last."""
    request = replace(superdense_request(file=file, rate_hz=RATE_HZ, time=PACED), run=run)
    try:
        result = runner.run(*superdense.begun(request, signals, Console(quiet=True)))
    except TransferError as error:
        raise NetworkError(f"superdense coding failed: {error}") from error
    shutil.rmtree(run.runs)
    assert isinstance(result.asking, SentFigures)
    return Measured(result.asking.pairs_per_s, result.packets_not_captured)
