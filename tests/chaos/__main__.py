"""Strikes runs at random, and holds them to account.

python tests/chaos --minutes 10 --seed 1      (root; `make chaos MINUTES=10 SEED=1`)
python tests/chaos --standing --strikes 100   (`make chaos STANDING=1 STRIKES=100`: standing.py)

Each strike has a run of its own: a job at random, a moment at random, and something of it at random
is killed, told to end, stopped or cut, beside bridges, namespaces and processes that are not ours.
No run may hang, deliver wrong bytes, leave anything behind or touch what is not its own; and the
cause is to be named, soon. Each is struck in namespaces of its own, several at once: this machine's
Open vSwitch is not touched. It looks at a run from outside, with none of its code.
"""

import argparse
import json
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass, field
from pathlib import Path
from random import Random

import machine
from jobs import JOBS, command
from strikes import Strike, strike

ROOT = Path(__file__).resolve().parents[2]
APART = str(ROOT / "topologies" / "own_namespaces")
LONGEST_WAIT_S = 9.0  # from the start to the strike
AFTER_START = 2.5  # before which there is little to strike
HANG_S = 90.0  # from the strike to the end
NAMED_S, STALLED_NAMED_S = 5.0, 30.0


@dataclass
class Outcome:
    """What one strike has led to."""

    number: int
    job: str
    strike: Strike | None
    status: int | None  # of the run; None: it hung
    cause: str = ""
    named_after_s: float | None = None
    slowness: float = 1.0  # how many processes shared a processor
    ended_after_s: float | None = None
    faults: list[str] = field(default_factory=list)
    leftovers: list[str] = field(default_factory=list)

    @property
    def named(self) -> bool:
        """Whether the cause is what was struck."""
        names = self.strike.names if self.strike else ()
        return any(name in self.cause for name in names)

    @property
    def blames_another(self) -> bool:
        """Whether something else is named than what was struck and must have been the cause."""
        return bool(self.cause and self.strike and self.strike.names) and not self.named

    @property
    def late(self) -> bool:
        """Whether the cause was named too late."""
        limit = STALLED_NAMED_S if self.strike and self.strike.stalls else NAMED_S
        return self.named_after_s is not None and self.named_after_s > limit


class Struck:
    """A run, from its start to its end; notes when it names a cause."""

    def __init__(self, words: tuple[str, ...], runs: Path) -> None:
        self._process = subprocess.Popen(
            command(words, runs),
            cwd=ROOT,
            env={**os.environ, "PYTHONUNBUFFERED": "1"},
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        self.pid = self._process.pid
        self.said: list[tuple[float, str]] = []
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            self.said.append((time.monotonic(), line.strip()))

    @property
    def running(self) -> bool:
        """Whether it has not ended."""
        return self._process.poll() is None

    def end(self, timeout_s: float) -> int | None:
        """Wait for its end; return the status, None for one that hangs, which is killed."""
        try:
            status = self._process.wait(timeout_s)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
            status = None
        self._reader.join(5)
        return status


def main() -> int:
    """Strike for so long, print each strike, and return 0 if all went well."""
    parser = argparse.ArgumentParser(prog="tests/chaos", description=__doc__)
    parser.add_argument("--minutes", type=float, default=3.0, help="for so long (3)")
    parser.add_argument("--strikes", type=int, default=1_000_000, help="at most so many")
    parser.add_argument("--first", type=int, default=0, help="number of the first, to repeat one")
    parser.add_argument("--seed", type=int, default=1, help="repeats jobs, moments and choices (1)")
    parser.add_argument("--log", type=Path, help="a line of JSON for each strike")
    parser.add_argument(
        "--at-once", type=int, default=os.cpu_count() or 1, help="so many (the processors)"
    )
    parser.add_argument(
        "--standing", action="store_true", help="strike one network that outlives it"
    )
    parser.add_argument("--worker", action="store_true", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.standing and not arguments.worker:
        words = [APART, sys.executable, str(Path(__file__).parent), *sys.argv[1:], "--worker"]
        return subprocess.run(words, cwd=ROOT, check=False).returncode
    if arguments.standing:
        return strike_standing(arguments)
    if arguments.worker:
        strike_on(arguments)
        return 0
    outcomes = beside_each_other(arguments)
    print(summary(outcomes))
    return 1 if any(bad(outcome) for outcome in outcomes) else 0


def strike_standing(arguments: argparse.Namespace) -> int:
    """Strike one network; print each strike, and return 0 if all went well."""
    # What starts a network loads the product, which those who only watch a run do without.
    sys.path.insert(0, str(ROOT))
    import standing

    deadline, made, wrong = time.monotonic() + 60 * arguments.minutes, 0, 0
    strikes = standing.strikes(arguments.strikes, arguments.seed, arguments.first)
    for each in strikes:
        print(standing.told(each), flush=True)
        made, wrong = made + 1, wrong + bool(each.faults)
        if time.monotonic() > deadline:
            strikes.close()
            break
    print(f"strikes          {made} at one network\nwrong            {wrong}")
    return 1 if wrong else 0


def strike_on(arguments: argparse.Namespace) -> None:
    """Make every n-th strike, as one of n who do; tell each outcome as a line of JSON."""
    # Below nohup it would be ignored, by all runs too, and no strike.
    signal.signal(signal.SIGHUP, signal.SIG_DFL)
    deadline = time.monotonic() + 60 * arguments.minutes
    last = arguments.first + arguments.strikes
    for number in range(arguments.first, last, arguments.at_once):
        if time.monotonic() > deadline:
            break
        print(json.dumps(asdict(one(number, arguments.seed))), flush=True)


def beside_each_other(arguments: argparse.Namespace) -> list[Outcome]:
    """Have strikes made on as many machines at once, which are namespaces of this one.

    Raise RuntimeError if somebody who makes them fails.
    """
    outcomes: list[Outcome] = []
    limit = ["--minutes", str(arguments.minutes), "--seed", str(arguments.seed)]
    workers = []
    for number in range(min(arguments.at_once, arguments.strikes)):
        part = ["--first", str(arguments.first + number)]
        part += ["--strikes", str(arguments.strikes - number)]
        part += ["--at-once", str(arguments.at_once), "--worker"]
        command = [APART, sys.executable, str(Path(__file__).parent), *limit, *part]
        workers.append(subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True))
    with ThreadPoolExecutor(len(workers)) as readers:
        ends = [readers.submit(heard, each, outcomes, arguments.log) for each in workers]
    if failed := [end.result() for end in ends if end.result()]:
        raise RuntimeError(f"{len(failed)} of {len(workers)} who strike ended with {failed}")
    return sorted(outcomes, key=lambda outcome: outcome.number)


def heard(worker: "subprocess.Popen[str]", outcomes: list[Outcome], log: Path | None) -> int:
    """Print and keep what somebody who strikes tells; return the exit status."""
    assert worker.stdout is not None
    for line in worker.stdout:
        fields = json.loads(line)
        made = fields.pop("strike")
        outcome = Outcome(**fields, strike=made and Strike(**made))
        outcomes.append(outcome)
        print(told(outcome), flush=True)
        if log:
            with log.open("a") as file:
                file.write(line)
    return worker.wait()


def one(number: int, seed: int) -> Outcome:
    """Make one strike on a run of its own."""
    random = Random(f"{seed}/{number}")
    mark = str(100_000 + number)
    with tempfile.TemporaryDirectory(prefix="chaos") as folder, machine.foreign_things(mark):
        place = Path(folder)
        theirs = random.random() < 0.5  # whether Open vSwitch runs already, with a bridge
        if theirs:
            machine.start_open_vswitch()
            bridge = ("add-br", machine.FOREIGN_BRIDGE, "--", "set", "bridge")
            kind = (machine.FOREIGN_BRIDGE, "datapath_type=netdev")
            machine.run("ovs-vsctl", "--timeout=60", "--may-exist", *bridge, *kind)
        before = machine.things()
        try:
            return _struck(number, random, place, before, mark)
        finally:
            if theirs:
                machine.start_open_vswitch()
                bridges = ("--if-exists", "del-br", machine.FOREIGN_BRIDGE)
                machine.run("ovs-vsctl", "--timeout=60", *bridges)
                machine.stop_open_vswitch()


def _struck(
    number: int, random: Random, place: Path, before: dict[str, set[str]], mark: str
) -> Outcome:
    job = random.choice(JOBS)(random, place)
    moment = random.uniform(AFTER_START, LONGEST_WAIT_S)
    run = Struck(job.words, place / "runs")
    started, made = time.monotonic(), None
    while run.running and made is None:
        time.sleep(max(0.0, started + moment - time.monotonic()))
        if run.running:
            made = strike(run.pid, random)
        moment += 0.5  # there was nothing to strike yet
    struck, slowness = time.monotonic(), machine.slowness()
    status = run.end(HANG_S)
    outcome = Outcome(number, " ".join(job.words[:1]), made, status)
    outcome.slowness = round(max(slowness, machine.slowness()), 1)
    causes = [(at, line) for at, line in run.said if line.startswith(("ending: ", "qmn: "))]
    if causes and made is not None:
        outcome.cause = causes[0][1]
        outcome.named_after_s = round(causes[0][0] - struck, 2)
    outcome.ended_after_s = round(time.monotonic() - struck, 2)
    if any("Traceback" in line for _at, line in run.said):
        outcome.faults.append("a traceback")
    folders = sorted((place / "runs").glob("2*"))
    outcome.faults += job.faults(folders[0], 1 if status is None else status) if folders else []
    outcome.leftovers = _left_after(place, before, made, status) + machine.harm(mark)
    return outcome


def _left_after(
    place: Path, before: dict[str, set[str]], made: Strike | None, status: int | None
) -> list[str]:
    """Return what is left: at once, or where the next run is to remove it, after that."""
    if made is not None and made.target in machine.DAEMONS and before["daemons"]:
        machine.start_open_vswitch()  # theirs, which is not a run's to start
        by_next = True
    else:
        by_next = status is None or (made is not None and made.ends)
    if by_next:
        after = Struck(("sdc", "--message", "after", "--no-capture"), place / "after")
        if (status := after.end(HANG_S)) != 0:
            last = " | ".join(line for _at, line in after.said[-4:])
            return [f"the next run failed with status {status}: {last}"]
    return machine.left(before)


def bad(outcome: Outcome) -> bool:
    """Whether something went wrong that must not, whatever was struck.

    A cause that is named late is counted only: how late depends on what else the machine does.
    """
    return outcome.status is None or bool(outcome.faults or outcome.leftovers)


def told(outcome: Outcome) -> str:
    """Return one strike in one line."""
    made = outcome.strike
    what = f"{made.how} to {made.target}" if made else "nothing (it had ended)"
    end = "HANGS" if outcome.status is None else f"status {outcome.status}"
    cause = f"; {outcome.named_after_s} s: {outcome.cause[:110]}" if outcome.cause else ""
    wrong = "".join(f"; WRONG: {fault}" for fault in (*outcome.faults, *outcome.leftovers))
    late = "; LATE" if outcome.late else ""
    return f"{outcome.number:4} {outcome.job:10} {what:28} {end}{cause}{late}{wrong}"


def summary(outcomes: list[Outcome]) -> str:
    """Return the counts."""
    made = [outcome for outcome in outcomes if outcome.strike]
    failed = [outcome for outcome in made if outcome.cause]
    timed = sorted(outcome.named_after_s or 0.0 for outcome in failed)
    other = [outcome for outcome in failed if outcome.blames_another]
    lines = [
        f"strikes          {len(made)} in {len(outcomes)} runs",
        f"hangs            {sum(outcome.status is None for outcome in outcomes)}",
        f"wrong bytes      {sum(bool(outcome.faults) for outcome in outcomes)}",
        f"leftovers, harm  {sum(bool(outcome.leftovers) for outcome in outcomes)}",
        f"cause named      in {len(failed)} runs; late in {sum(o.late for o in failed)}",
        f"another named    {len(other)}",
        f"a processor had  {max((o.slowness for o in outcomes), default=1):g} processes at most",
        *(f"                 {told(outcome)}" for outcome in other),
    ]
    if timed:
        middle, last = timed[len(timed) // 2], timed[-1]
        lines.append(f"time to cause    p50 {middle:.2f} s, longest {last:.2f} s")
    return "\n".join(lines)


if __name__ == "__main__":
    sys.exit(main())
