"""Run one program of a NetQASM application on this host, as it is, with NetQASM's SDK.

Prints a line of JSON for what each round returns, and one at the end; what the program itself
prints, and logs by NetQASM's logger, goes to stderr.
"""

import argparse
import json
import os
import sys
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stdout
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from typing import Any

from netqasm.logging.glob import set_log_level
from netqasm.runtime.app_config import AppConfig
from netqasm.sdk.config import LogConfig

from applications.netqasm.external import installed
from applications.netqasm.outcomes import plain
from applications.netqasm.placement import Placement
from applications.netqasm.process_time import counting
from applications.netqasm.ranks import counts
from hosts.applications.carrying import say
from hosts.applications.service import clock_of, ended_well
from hosts.stack_socket import QuantumSocketError

Main = Callable[..., Any]


def load(folder: Path, role: str) -> Main:
    """Return the entry of a program; its own modules are found beside it."""
    file = folder / f"app_{role}.py"
    sys.path.insert(0, str(folder))
    spec = spec_from_file_location(file.stem, file)
    assert spec is not None
    assert spec.loader is not None
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    main: Main = module.main
    return main


def begin(main: Main, role: str, host: str, inputs: dict[str, Any], logs: Path) -> Any:
    log_config = LogConfig(log_subroutines_dir=str(logs), comm_log_dir=str(logs))
    config = AppConfig(role, host, main, log_config, inputs)
    return main(app_config=config, **inputs)


class ProgramError(Exception):
    """A program has failed: the text says of which role, where, and why."""


@contextmanager
def located(role: str, folder: Path, number: int | None = None) -> Iterator[None]:
    """Raise errors with the role, the round, counted from 0, and the line in the folder."""
    try:
        yield
    except Exception as error:
        frames = traceback.extract_tb(error.__traceback__)
        of_program = [frame for frame in frames if Path(frame.filename).is_relative_to(folder)]
        parts = [role] if number is None else [role, f"round {number + 1}"]
        parts += [f"{Path(each.filename).name}, line {each.lineno}" for each in of_program[-1:]]
        place = ", ".join(parts)
        if isinstance(error, QuantumSocketError):
            raise QuantumSocketError(f"{place}: {error}", error.reason) from error
        raise ProgramError(f"{place}: {type(error).__name__}: {error}") from error


def parsed() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="python -m applications.netqasm.program", description=__doc__
    )
    text = "folder of the application, or file of a NetQMPI program"
    parser.add_argument("path", type=Path, help=text)
    parser.add_argument("role", help="app_ROLE.py is run, or the program's rank")
    parser.add_argument("--stack", help="socket of this host's stack (QMN_STACK)")
    parser.add_argument("--placement", type=json.loads, help="hosts and addresses by role")
    parser.add_argument("--inputs", type=json.loads, default={}, help="of the program, as JSON")
    parser.add_argument("--rounds", type=int, default=1, metavar="N", help="times to run it (1)")
    text = "of the gate that steps the network's time"
    parser.add_argument("--time-folder", default="", help=text)
    parser.add_argument("--logs", type=Path, required=True, help="folder for what the SDK logs")
    return parser.parse_args()


def main() -> int:
    arguments = parsed()
    role = arguments.role
    placement = Placement(**arguments.placement, stacks={role: arguments.stack})
    program = arguments.path.is_file()
    folder = arguments.path.parent if program else arguments.path
    os.chdir(folder)
    set_log_level("INFO")

    def work_of_rank() -> None:
        stream = sys.stdout

        def on_round(number: int) -> None:
            with redirect_stdout(stream):
                say("round", {"round": number})

        with installed(placement, on_round), redirect_stdout(sys.stderr):
            rank, size = list(placement.hosts).index(role), len(placement.hosts)
            with located(role, folder):
                totals = counts(arguments.path, rank, size, arguments.rounds)
        say("result", {"round": 0, "output": totals})
        say("done", {"rounds": arguments.rounds})

    def work() -> None:
        with installed(placement) as ends:
            with redirect_stdout(sys.stderr), located(role, folder):
                entry = load(folder, role)
            for number in range(arguments.rounds):
                with redirect_stdout(sys.stderr), located(role, folder, number):
                    host = placement.host(role)
                    output = begin(entry, role, host, arguments.inputs, arguments.logs)
                    output = plain(output)
                say("result", {"round": number, "output": output})
                ends[role].wait()
        say("done", {"rounds": arguments.rounds})

    with counting(clock_of(arguments.time_folder)):
        return ended_well("netqasm_program", work_of_rank if program else work)


if __name__ == "__main__":
    sys.exit(main())
