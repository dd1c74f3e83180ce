"""Sweeps of jobs that start networks of their own, as keys: a run for each point.

Their axes are the flags of the command line; their columns are the figures of who asks. NetQASM's
programs have none: of each role that always returns one number the mean is measured.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import Field, fields, is_dataclass
from itertools import chain, product
from pathlib import Path
from typing import Any

from evidence.curves.estimates import NOTHING, Estimate, mean_of_draws
from evidence.curves.experiment import Measure, Outcome
from evidence.curves.parameters import BadGrid, Value
from qmn.options import BadInput, flag_of
from qmn.requests.kinds import RECORDED_REQUESTS
from qmn.requests.of_job import FLAGS
from qmn.results.run_folder import begin_folder
from qmn.results.run_result import RunResult
from qmn.scripting import own_run
from wire.parameters.option import declared
from wire.results.figures import Figures, LoadFigures, StoredKeyFigures, TunnelFigures
from wire.results.run_result import NetqasmJob, Round

NETQASM, APPLICATION, INPUT = "netqasm", "application", "input"
FIGURES: Mapping[str, type[Figures]] = {
    "keys": StoredKeyFigures,
    "vpn": TunnelFigures,
    "load": LoadFigures,
    NETQASM: Figures,
}
HELP = {
    "keys": "keep stores of keys filled (--seconds)",
    "vpn": "move a file through a tunnel by such keys",
    "load": "many sessions of many hosts",
    NETQASM: "run programs of NetQASM (--application FOLDER)",
}
WHAT = {name: text for name, text in HELP.items() if name in RECORDED_REQUESTS}
LEFT_OUT = {"seed", "runs", "without"}  # a sweep sets them


Axes = Mapping[str, Sequence[Value]]


def options(job: str) -> dict[str, "Field[Any]"]:
    by_flag = {FLAGS.get(name, name): each for name, each in _flags(RECORDED_REQUESTS[job].kind)}
    return {name: each for name, each in by_flag.items() if name not in LEFT_OUT}


def _flags(kind: Any) -> Iterator[tuple[str, "Field[Any]"]]:
    for field in fields(kind):
        if isinstance(field.type, type) and is_dataclass(field.type):
            yield from _flags(field.type)
        elif "help" in (declaration := declared(field)) and (flag := flag_of(field, declaration)):
            yield flag.removeprefix("--").replace("-", "_"), field


def roles(axes: Axes) -> list[str]:
    """Return those of the NetQASM applications on the axes; raise BadGrid for what is none."""
    from applications.netqasm.job import roles_of  # loads NetQASM's SDK

    if APPLICATION not in axes:
        raise BadGrid(f"{NETQASM}: say which application: --{APPLICATION} FOLDER")
    try:
        names = [
            role
            for path, ranks in product(axes[APPLICATION], axes.get("ranks", [None]))
            for role in roles_of(Path(str(path)), None if ranks is None else int(ranks))
        ]
    except BadInput as error:
        raise BadGrid(str(error)) from error
    return [*dict.fromkeys(names)]


def measures(job: str, axes: Axes) -> tuple[Measure, ...]:
    if job == NETQASM:
        of_job = [Measure(role, f"what {role} returns, mean") for role in roles(axes)]
    else:
        names = [field.name for field in fields(FIGURES[job])]  # type: ignore[arg-type]
        of_job = [Measure(name, name.replace("_", " ")) for name in names]
    latency = Measure("latency_s", "latency of the whole job (s)")
    offered = (*of_job, latency, Measure("pairs_made", "pairs made by sources"))
    return tuple(each for each in offered if each.name not in axes)


def measure(job: str, content: Mapping[str, Any], names: Sequence[str], runs: Path) -> Outcome:
    options = dict(content)
    arguments = [str(options.pop(APPLICATION))] if job == NETQASM else []
    if INPUT in options:
        options[INPUT] = str(options[INPUT]).split()
    folder = begin_folder(runs, job)
    result = own_run.run(job, *arguments, folder=folder, without="report", **options)
    return {name: _found(result, name) for name in names}


def _found(result: RunResult, name: str) -> Estimate:
    if isinstance(result.job, NetqasmJob) and name in result.job.roles:
        return of_rounds(result.job.outputs, name)
    of_run = {"latency_s": result.elapsed_s, "pairs_made": result.pairs_made}
    value = of_run[name] if name in of_run else vars(result.asking).get(name)
    return NOTHING if value is None else Estimate(float(value), 0.0)


def of_rounds(outputs: Sequence[Round], role: str) -> Estimate:
    """Return the mean of the one number that a role's program returns in each round."""
    numbers = [_numbers(output.get(role)) for output in outputs]
    if not numbers or any(len(number) != 1 for number in numbers):
        return NOTHING
    return mean_of_draws(list(chain.from_iterable(numbers)))


def _numbers(output: object) -> list[float]:
    if isinstance(output, bool | int | float):
        return [float(output)]
    parts = [*output.values()] if isinstance(output, dict) else output
    return [n for part in parts for n in _numbers(part)] if isinstance(parts, list) else []
