"""Counts wrong leaps of stepped time: `make chaos LEAPS=1000`.

Parties on the hosts of a network pass pieces of work on (party.py), and beside them two hosts open
sessions of light. A leap is wrong if a piece of work was under way, or if it went beyond an instant
at which a message or a timer was due that nobody had handled. Each party reports the spans in which
time should have stood, by its own looks at the clock. A message is due when the cables have let it
through. Every session takes as long to set up, as programs take no time. So neither is a word of
the gate.

bin/qmn script tests/chaos/leaps.py --leaps 1000      (in namespaces of its own: __main__.py)
"""

import argparse
import json
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import astuple, dataclass, field
from functools import partial
from pathlib import Path
from random import Random
from typing import IO, Any
from unittest.mock import patch

from qmn.jobs.transfer import TransferError
from qmn.scripting import QuantumNetwork, start
from topologies.nodes import gate as gate_of_networks
from topologies.system.processes.programs import Program, python
from topologies.system.runs.launching import write
from topologies.system.runs.runtime import TIME, Runtime
from wire.config import Config
from wire.leaps import LEAP, LEAPS

PARTY = Path(__file__).with_name("party.py")
LEAPS_OF_A_NETWORK = 10_000
LOOK_S = 0.5
HANG_S = 120.0  # without a leap
NS = 1_000_000_000
TOPOLOGIES: tuple[dict[str, Any], ...] = ({"topo": "sdc"}, {"topo": "ring", "switches": 3})
LENGTHS_KM = (0.1, 1.0, 20.0)

Span = tuple[int, int]  # from an instant to another one, in which time should have stood


@dataclass
class Count:
    """The findings in networks."""

    leaps: int = 0
    pieces: int = 0
    sessions: int = 0
    wrong: int = 0

    def __add__(self, other: "Count") -> "Count":
        return Count(*(one + more for one, more in zip(astuple(self), astuple(other), strict=True)))

    def __str__(self) -> str:
        work = f"{self.pieces:,} pieces of work, {self.sessions:,} sessions"
        return f"leaps {self.leaps:,}, wrong {self.wrong:,} ({work})"


def wrong_leaps(instants: list[int], spans: list[Span]) -> int:
    """Return how many leaps were made within spans, of which one without a leap counts as one."""
    wrong, more = set[int](), 0
    for begin_ns, end_ns in spans:
        within = {instant for instant in instants if begin_ns < instant <= end_ns}
        wrong |= within
        more += not within
    return len(wrong) + more


class Parties:
    """The parties on the hosts of a network."""

    def __init__(self, network: QuantumNetwork, seed: str, programs: ExitStack) -> None:
        """Start them, each with a piece of work."""
        runtime, names = network.runtime, network.quantum_hosts
        cable_ns = {name: round(NS * runtime.copper[frozenset((name, "s1"))]) for name in names}
        self._pipes: list[tuple[IO[str], IO[str]]] = []
        for name in names:
            settings = {
                "name": name,
                "seed": seed,
                "addresses": {each: runtime.addresses[each] for each in names},
                "delays_ns": {each: cable_ns[each] + cable_ns[name] for each in names},
                "folder": str(runtime.own_folder(TIME)),
                "since_ns": runtime.time.since_ns,
            }
            program = network.host(name).popen(
                [python(), str(PARTY), json.dumps(settings)],
                text=True,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=None,
            )
            programs.enter_context(program)
            programs.callback(program.kill)
            self._pipes.append((program.stdin, program.stdout))
        for expected in ("listens", "ready"):
            for _words, text in self._pipes:
                if json.loads(text.readline() or "null") != expected:
                    raise RuntimeError("a party has ended")
            for words, _said in self._pipes:
                print(file=words, flush=True)

    def end(self) -> Iterator[tuple[int, list[Span]]]:
        """End the game; yield how much work each party has done, and its spans."""
        for words, _said in self._pipes:
            words.close()
        for _words, text in self._pipes:
            report = json.loads(text.readline())
            yield report["pieces"], [(begin_ns, end_ns) for begin_ns, end_ns in report["spans"]]


@dataclass
class Sessions:
    """Sessions of light between two hosts, one after the other."""

    network: QuantumNetwork
    failure: str = ""
    _setups: list[Span] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._open, daemon=True)
        self._thread.start()

    def _open(self) -> None:
        one, other = self.network.quantum_hosts[:2]
        while not (self._over.is_set() or self.failure):
            asked_ns = self.network.runtime.time.now_ns()
            try:
                opened = self.network.send(one, other, b"light")
            except TransferError as error:
                self.failure = str(error)
            else:
                self._setups.append((asked_ns, asked_ns + round(NS * opened.setup_s)))

    def end(self) -> tuple[int, list[Span]]:
        """Wait for the last; return how many there were, and by what some were slower."""
        self._over.set()
        self._thread.join()
        least_ns = min((end_ns - begin_ns for begin_ns, end_ns in self._setups), default=0)
        late = [(begin_ns + least_ns, end_ns) for begin_ns, end_ns in self._setups]
        return len(self._setups), [span for span in late if span[0] < span[1]]


def count_in(network: QuantumNetwork, run: Path, leaps: int, seed: str) -> Count:
    """Play in a network until it has made a number of leaps; raise RuntimeError if it hangs."""
    file, begun_ns = run / LEAPS, network.runtime.time.now_ns()
    before, changed_s, wanted = 0, time.monotonic(), file.stat().st_size + leaps * LEAP.size
    with ExitStack() as programs:
        parties, sessions = Parties(network, seed, programs), Sessions(network)
        while (size := file.stat().st_size) < wanted:
            network.check()
            if size > before:
                before, changed_s = size, time.monotonic()
            elif time.monotonic() > changed_s + HANG_S:
                raise RuntimeError((run / "gate.log").read_text())
            time.sleep(LOOK_S)
        opened, late = sessions.end()
        reports = [*parties.end()]
    spans = [*late, *(span for _pieces, own in reports for span in own)]
    instants = [instant for _wall, instant in LEAP.iter_unpack(file.read_bytes())]
    made = [instant for instant in instants if instant > begun_ns]
    if sessions.failure:
        print(f"WRONG: {sessions.failure}", flush=True)
    wrong = wrong_leaps(made, spans) + bool(sessions.failure)
    return Count(len(made), sum(pieces for pieces, _spans in reports), opened, wrong)


def start_gate(file: str, network: Runtime, name: str, _module: str, config: Config) -> Program:
    """Start a program in place of the gate."""
    program = network.program(name)
    program.start([python(), file, "--config", str(write(network, name, config, {}))])
    return program


def main() -> int:
    """Count as the command line says; return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--leaps", type=int, required=True)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--gate", help="a program in place of the gate")
    arguments = parser.parse_args()
    if arguments.gate:
        launch = partial(start_gate, arguments.gate)
        with patch.object(gate_of_networks, "launch", launch):
            return count(arguments.leaps, arguments.seed)
    return count(arguments.leaps, arguments.seed)


def count(most: int, first_seed: int) -> int:
    """Count in networks, one after the other; return 0 if no leap was wrong."""
    total, number = Count(), 0
    while total.leaps < most:
        seed = f"{first_seed}/{number}"
        random, leaps = Random(seed), min(LEAPS_OF_A_NETWORK, most - total.leaps)
        options, km = random.choice(TOPOLOGIES), random.choice(LENGTHS_KM)
        with tempfile.TemporaryDirectory(prefix="leaps") as folder:
            run = Path(folder) / "run"
            with start(folder=run, time="stepped", length_km=km, **options) as network:
                found = count_in(network, run, leaps, seed)
        print(f"{number:4} {options['topo']:5} {km:4g} km  {found}", flush=True)
        total, number = total + found, number + 1
    print(total)
    return 1 if total.wrong else 0


if __name__ == "__main__":
    sys.exit(main())
