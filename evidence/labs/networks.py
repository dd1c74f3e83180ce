"""The runs of a lab: each is a `qmn` of its own, one after the other.

A lab names each run by the command that a reader would type; its own script may do anything to its
process.
"""

import json
import shlex
from collections.abc import Callable
from pathlib import Path

from evidence.labs.lab import Run
from qmn.scripting import own_run
from qmn.timeouts import LAB_RUN_TIMEOUT_S
from topologies.system.processes.programs import NetworkError
from wire.results.run_result import RESULT


def command_for(words: str, seed: int, runs: Path) -> list[str]:
    return [*shlex.split(words), "--seed", str(seed), "--runs", str(runs)]


def carry_out(name: str, words: str, seed: int, folder: Path, check: Callable[[], None]) -> Run:
    """Start a network, do its job, and return what it left in a folder of the lab's.

    Raise NetworkError if it fails; `check` may end it by raising.
    """
    runs, log = folder / name, folder / f"{name}.log"
    command = command_for(words, seed, runs)
    try:
        left = own_run.carry_out(name, command, runs, log, limit_s=LAB_RUN_TIMEOUT_S, check=check)
    except NetworkError as error:
        raise NetworkError(f"{error}; see {log}") from error
    return left_in(left)


def left_in(folder: Path) -> Run:
    return Run(folder, json.loads((folder / RESULT).read_text()))
