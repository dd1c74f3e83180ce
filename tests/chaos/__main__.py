"""Strikes runs at random, and holds them to account.

python tests/chaos --minutes 10 --seed 1      (root; `make chaos MINUTES=10 SEED=1`)
python tests/chaos --standing --strikes 100   (`make chaos STANDING=1 STRIKES=100`: standing.py)
python tests/chaos --leaps 1000               (`make chaos LEAPS=1000`: leaps.py)

Each run has a job at random and is struck at a moment of its life at random (under_way.py):
something of it is killed, asked to end, stopped or cut, beside namespaces and processes that are
not ours. If it goes on, or while it ends, it may be struck again. No run may hang, deliver
wrong bytes, leave anything behind or touch what is not its own; and it names the cause, soon. It
looks at a run from outside, with none of its code. Those who strike have namespaces of their own,
so that several do at once.

Limits hold for a run that has a processor whenever it wants one. Beside others it gets more time,
as much more as the kernel says that its process has had to wait for a processor (machine.slowed).
"""

import argparse
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict
from pathlib import Path
from random import Random

import machine
from jobs import JOBS, Job, command, whole
from outcomes import Made, Outcome, bad, describe, first_report, from_fields, summary, too_few
from strikes import strike
from under_way import DISK, OUTPUTS, ROOT, UnderWay, drawn

# In namespaces of its own, and it ends with its starter.
APART = ("setpriv", "--pdeathsig", "KILL", str(ROOT / "topologies" / "own_namespaces"))
LEAPS = Path(__file__).with_name("leaps.py")
STRIKES_OF_A_RUN = (1, 2, 3, 4)  # at most: it may have ended before the second
HANG_S = 90.0  # from the last strike to the end
LAST_WORDS = 6  # lines of a run that went wrong, which are shown
UNBOUNDED = 1_000_000  # strikes, where time alone ends them
UNSTRUCK_S = 600.0  # that a run which nobody strikes may take on a machine that does much else


def main() -> int:
    """Strike for the given time, print each strike, and return 0 if all went well."""
    parser = argparse.ArgumentParser(prog="tests/chaos", description=__doc__)
    parser.add_argument("--minutes", type=float, default=3.0, help="how long (3)")
    parser.add_argument(
        "--strikes", type=int, help="number of strikes, or a few more; fewer are a fault"
    )
    parser.add_argument("--first", type=int, default=0, help="number of the first, to repeat one")
    parser.add_argument("--seed", type=int, default=1, help="repeats jobs, moments and choices (1)")
    parser.add_argument("--log", type=Path, help="a line of JSON for each strike")
    parser.add_argument(
        "--at-once",
        type=int,
        default=os.cpu_count() or 1,
        help="strikes at a time (the processors)",
    )
    parser.add_argument(
        "--standing", action="store_true", help="strike one network that outlives it"
    )
    parser.add_argument("--leaps", type=int, help="leaps of stepped time to look at")
    parser.add_argument("--worker", action="store_true", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.leaps:
        script = ["script", str(LEAPS), "--leaps", str(arguments.leaps)]
        words = [*APART, str(ROOT / "bin/qmn"), *script, "--seed", str(arguments.seed)]
        return subprocess.run(words, cwd=ROOT, check=False).returncode
    wanted, arguments.strikes = arguments.strikes, arguments.strikes or UNBOUNDED
    if arguments.standing and not arguments.worker:
        words = [*APART, sys.executable, str(Path(__file__).parent), *sys.argv[1:], "--worker"]
        return subprocess.run(words, cwd=ROOT, check=False).returncode
    if arguments.standing:
        return strike_standing(arguments, wanted)
    if arguments.worker:
        strike_on(arguments)
        return 0
    outcomes, failed = beside_each_other(arguments)
    print(summary(outcomes))
    if failed:
        print(f"of those who strike, {len(failed)} ended with {failed}")
    made = sum(len(outcome.made) for outcome in outcomes)
    if fewer := too_few(made, wanted, arguments.minutes):
        print(fewer)
    return 1 if failed or fewer or any(bad(outcome) for outcome in outcomes) else 0


def strike_standing(arguments: argparse.Namespace, wanted: int | None) -> int:
    """Strike one network; print each strike, and return 0 if all went well."""
    # A starter of networks loads the product; a run alone is watched without it.
    sys.path.insert(0, str(ROOT))
    import standing

    deadline, made, wrong = time.monotonic() + 60 * arguments.minutes, 0, 0
    for each in standing.strikes(arguments.strikes, arguments.seed, arguments.first, deadline):
        print(standing.describe(each), flush=True)
        made, wrong = made + each.is_strike, wrong + bool(each.faults)
    print(f"strikes          {made} at one network\nwrong            {wrong}")
    if fewer := too_few(made, wanted, arguments.minutes):
        print(fewer)
    return 1 if wrong or fewer else 0


def strike_on(arguments: argparse.Namespace) -> None:
    """Strike every n-th run, as one of n who do; tell each outcome as a line of JSON."""
    # Below nohup it would be ignored, by all runs too, and no strike.
    signal.signal(signal.SIGHUP, signal.SIG_DFL)
    lengths = lengths_of_phases()
    deadline = time.monotonic() + 60 * arguments.minutes
    number, made = arguments.first, 0
    while made < arguments.strikes and time.monotonic() < deadline:
        outcome = one(number, arguments.seed, lengths)
        print(json.dumps(asdict(outcome)), flush=True)
        number, made = number + arguments.at_once, made + len(outcome.made)


def lengths_of_phases() -> dict[str, float]:
    """Return how long each phase of a run takes that nobody strikes; seconds."""
    with tempfile.TemporaryDirectory(prefix="chaos") as folder:
        place = Path(folder)
        job = whole(place)
        run = UnderWay(command(job.words, place / "runs"))
        if status := run.end(UNSTRUCK_S):
            text = " | ".join(line for _at, line in run.lines[-4:])
            raise RuntimeError(f"a run that nobody strikes ended with status {status}: {text}")
        return run.lengths()


def beside_each_other(arguments: argparse.Namespace) -> tuple[list[Outcome], list[int]]:
    """Have strikes made on as many machines at once, which are namespaces of this one.

    Return the outcomes, and how those ended who strike and could not go on.
    """
    outcomes: list[Outcome] = []
    limit = ["--minutes", str(arguments.minutes), "--seed", str(arguments.seed)]
    workers = []
    for number in range(min(arguments.at_once, arguments.strikes)):
        part = ["--first", str(arguments.first + number)]
        part += ["--strikes", str(-(-(arguments.strikes - number) // arguments.at_once))]
        part += ["--at-once", str(arguments.at_once), "--worker"]
        command = [*APART, sys.executable, str(Path(__file__).parent), *limit, *part]
        workers.append(subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True))
    with ThreadPoolExecutor(len(workers)) as readers:
        ends = [readers.submit(heard, each, outcomes, arguments.log) for each in workers]
    failed = [end.result() for end in ends if end.result()]
    return sorted(outcomes, key=lambda outcome: outcome.number), failed


def heard(worker: "subprocess.Popen[str]", outcomes: list[Outcome], log: Path | None) -> int:
    """Print and keep what somebody who strikes tells; return the exit status."""
    assert worker.stdout is not None
    for line in worker.stdout:
        outcome = from_fields(json.loads(line))
        outcomes.append(outcome)
        print(describe(outcome), flush=True)
        if log:
            with log.open("a") as file:
                file.write(line)
    return worker.wait()


def one(number: int, seed: int, lengths: dict[str, float]) -> Outcome:
    """Strike a run of its own."""
    random = Random(f"{seed}/{number}")
    mark = str(100_000 + number)
    with tempfile.TemporaryDirectory(prefix="chaos") as folder, machine.foreign_things(mark):
        place = Path(folder)
        before = machine.things()
        job = random.choice(JOBS)(random, place)
        outcome = _struck(number, random, job, place, lengths)
        outcome.leftovers = machine.left(before) + machine.harm(mark)
        if folders := sorted((place / "runs").glob("2*")):  # nothing writes there any more
            status = 1 if outcome.status is None else outcome.status
            outcome.faults += job.faults(folders[0], status)
        return outcome


def _struck(
    number: int, random: Random, job: Job, place: Path, lengths: dict[str, float]
) -> Outcome:
    moment = drawn(random)
    # Most follow soon: a run that a strike ends takes but a moment to do so.
    pauses = [random.random() ** 4 for _ in range(random.choice(STRIKES_OF_A_RUN) - 1)]
    if job.session_s is not None:
        lengths = lengths | {"session": job.session_s}
    where, disk = random.choice(OUTPUTS), place / "disk"
    disk.mkdir()
    run = UnderWay(command(job.words, place / "runs"), where, disk if where == DISK else None)
    run.wait_until(moment, lengths)
    first, made = time.monotonic(), _made(run, random, time.monotonic())
    for share in pauses:
        run.wait(share * (lengths["report"] + lengths["end"]))
        made += _made(run, random, first)
    last = time.monotonic()
    outcome = Outcome(number, job.words[0], moment, made, run.end(HANG_S * run.slowed))
    outcome.last_words = [line for _at, line in run.lines[-LAST_WORDS:]]
    outcome.slowed = round(run.slowed, 1)
    causes = [(at, line) for at, line in run.lines if line.startswith(("ending: ", "qmn: "))]
    if causes and made:
        at, outcome.cause = causes[0]
        outcome.cause_after_s = round(first_report(run.lines, outcome.cause, at) - first, 2)
    outcome.ended_after_s = round(time.monotonic() - last, 2)
    if any("Traceback" in line for _at, line in run.lines):
        outcome.faults.append("a traceback")
    return outcome


def _made(run: UnderWay, random: Random, first: float) -> list[Made]:
    """Strike something of a run; wait for it if there is nothing yet."""
    while run.running:
        phase, now = run.phase, time.monotonic()
        if (found := strike(run, random)) is not None:
            return [Made(found, phase, round(now - first, 2))]
        run.wait(0.05)
    return []


if __name__ == "__main__":
    sys.exit(main())
