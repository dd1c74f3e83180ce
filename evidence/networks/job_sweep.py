"""Sweeps of any job over the network: its options and settings as axes, several points a network.

An axis is an option of `qmn run JOB` (switches, count), or a setting of a part: node.memory.t2_s
of every host (and switch, of swap), bob.memory.t2_s of one, fiber.NAME and switch.NAME of all,
q1-q2.NAME of a fibre.
Points that differ in options of the job alone share a network that goes on standing.
"""

import math
from argparse import ArgumentTypeError
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import Field, dataclass, fields
from pathlib import Path
from typing import Any

from evidence.curves.experiment import Experiment, Outcome, SweepError
from evidence.curves.grid import Grid
from evidence.curves.parameters import BadGrid, Parameter, Value, Values, point_seed
from evidence.networks import run_sweep
from evidence.networks.metrics import measures_of, outcome_of
from hosts.middleware.services import named
from hosts.middleware.session.errors import SessionError
from qmn.jobs.on_network import network_for
from qmn.jobs.transfer import TransferError
from qmn.network.custom_topology import BadTopology
from qmn.network.options import NetworkOptions
from qmn.network.part_options import FIBER, SWITCH
from qmn.network.time_scale import STEPPED
from qmn.network.topologies import topology
from qmn.options import BadInput, kind_of
from qmn.requests.of_job import FLAGS, OF_NETWORK
from qmn.requests.service import ServiceRequest
from qmn.requests.service_verbs import VERBS
from qmn.requests.superdense import SuperdenseRequest
from qmn.results.run_folder import begin_folder
from qmn.scripting import start_for
from topologies.system.processes.programs import NetworkError
from wire.parameters.checks import check_names, remedy
from wire.parameters.option import declared, unit_of
from wire.parameters.physics import ADJUSTABLE, Device

SEVERAL = {run_sweep.APPLICATION, run_sweep.INPUT}  # texts, which commas part
OF_PARTS = "fiber", "switch", "node", "device"  # options that are lists of words
TEXT = "a text"
SWITCHES = {"on": True, "off": False}
AT_START = OF_NETWORK | {"schedule", "purify", "protocol", "source", "sender", "receiver"}
MOST_SHOWN = 40  # characters of a value, as a message is one
MOST_POINTS = 500  # on one network
LEAST_POINTS = 5  # on each, if points are shared out among networks


@dataclass(frozen=True)
class JobSweep(Experiment):
    """A sweep of a job, whose parameters are the axes that were given."""

    @property
    def file(self) -> str:
        """Return the name of its table: other axes are other columns."""
        return "-".join((self.name, *(self.names or ["network"])))

    def groups(self, points: Sequence[Values], at_once: int) -> Iterator[list[Values]]:
        if self.name in run_sweep.WHAT:
            yield from ([values] for values in points)
            return
        by_fixed: dict[tuple[Value, ...], list[Values]] = {}
        for values in points:
            fixed = tuple(value for name, value in values.items() if is_at_start(name))
            by_fixed.setdefault(fixed, []).append(values)
        for group in by_fixed.values():
            shares = max(1, min(at_once // len(by_fixed), len(group) // LEAST_POINTS))
            size = math.ceil(len(group) / max(shares, math.ceil(len(group) / MOST_POINTS)))
            yield from (group[begin : begin + size] for begin in range(0, len(group), size))


def is_at_start(name: str) -> bool:
    if "." not in name:
        return FLAGS.get(name, name) in AT_START
    part, _dot, setting = setting_of(name).name.partition(".")
    return part != "memory" or setting not in ADJUSTABLE


def networks_of(grid: Grid) -> str:
    """Return in words which axes start a network for each of their values."""
    if grid.experiment.name in run_sweep.WHAT:
        return "a network for each point"
    axes = [name for name, values in grid.axes.items() if is_at_start(name) and len(values) > 1]
    return f"a network for each {' and '.join(axes)}" if axes else "on networks they share"


def grid_of(job: str, chosen: Mapping[str, object]) -> Grid:
    """Return the grid of a job's axes; raise BadGrid for what cannot be, before any start."""
    chosen = dict(chosen)
    if isinstance(named := chosen.pop("topology", None), str):
        chosen = {**_shape(named), **chosen}
    # Points of a network are neighbours, and those of one setting of its memories.
    names = sorted(chosen, key=lambda name: (is_at_start(name), "." in name), reverse=True)
    parameters = {name: parameter_of(job, name) for name in names}
    for name in SEVERAL & parameters.keys():
        parameters[name] = Parameter(name, "", choices=tuple(str(chosen[name]).split(",")))
    axes: dict[str, list[Value]] = {
        name: [str(chosen[name])] if each.text else each.axis(chosen[name])
        for name, each in parameters.items()
    }
    is_job = job in run_sweep.WHAT
    measures = run_sweep.measures(job, axes) if is_job else measures_of(job)
    what = f"{job}: {WHAT[job]}"
    grid = Grid(JobSweep(job, what, tuple(parameters.values()), measures), axes)
    if is_job:
        return grid
    first = {name: values[0] for name, values in axes.items()}
    for name, values in axes.items():
        for value in values:
            check(job, {**first, name: value})
    return grid


def _shape(text: str) -> dict[str, object]:
    """Return the topology and its parameters as axes of one value: chain,switches=5."""
    try:
        return dict[str, object](topology(text))
    except ArgumentTypeError as error:
        raise BadGrid(f"topology {error}") from error


WHAT = {"sdc": "send a message by superdense coding", **{k: v.help for k, v in VERBS.items()}}
WHAT |= run_sweep.WHAT


def check(job: str, values: Values) -> None:
    """Raise BadGrid for a point that the job cannot be."""
    try:
        network_for(job, options_of(job, values, 1))
    except (BadInput, BadTopology, SessionError) as error:
        raise BadGrid(str(error)) from error


def parameter_of(job: str, name: str) -> Parameter:
    """Return an option or a setting as a parameter; raise BadGrid for one there is not."""
    if "." in name:
        return _parameter_of_part(name)
    if name == "topology" or (job, name) == (run_sweep.NETQASM, run_sweep.APPLICATION):
        return Parameter(name, "", text=TEXT)
    options = _options(job)
    option = options.get(FLAGS.get(name, name))
    if option is None:
        listed = (f"those of `qmn run {job} --help`",)
        raise BadGrid(f"{job} has no option {name}: {remedy(name, options, listed)}")
    declaration, kind = declared(option), kind_of(option.type)
    if kind is bool:
        return Parameter(name, "off", choices=tuple(SWITCHES))
    if "choices" in declaration:
        return Parameter(name, "", choices=tuple(declaration["choices"]))
    if kind not in (int, float):  # also lists of words, which spaces part
        return Parameter(name, "", text=TEXT)
    return _number(name, kind, declaration.get("range"), unit_of(name, declaration.get("metavar")))


def _number(name: str, kind: Any, limits: tuple[float, float] | None, unit: str) -> Parameter:
    least, most = limits or (-math.inf, math.inf)
    if kind is int:
        least = int(max(least, 0))
    return Parameter(name, "", least, most, unit)


def _options(job: str) -> dict[str, "Field[Any]"]:
    """Return the declared options of a job and its network by their names in Python."""
    if job in run_sweep.WHAT:
        return run_sweep.options(job)
    of_job: list[type[Any]] = [SuperdenseRequest, named()["sdc"].options]
    if job in VERBS:
        services = VERBS[job].protocols or (job,)
        of_job = [ServiceRequest, named()[services[0]].options]
    kinds = (*of_job, NetworkOptions)
    by_name: dict[str, Field[Any]] = {field.name: field for kind in kinds for field in fields(kind)}
    with_help = {name: each for name, each in by_name.items() if "help" in declared(each)}
    del with_help["seed"]  # of the sweep
    return with_help | {"receiver": by_name["host"]}


@dataclass(frozen=True)
class Setting:
    """A setting of parts, as an option of networks has it: --device *.memory.t2_s=…"""

    option: str
    place: str  # of a part, "" or a pattern for all
    name: str

    def word(self, value: Value) -> str:
        return f"{self.place}.{self.name}={value}".removeprefix(".")


def setting_of(axis: str) -> Setting:
    """Return the setting of an axis: by its dots that of a host's device, or of fibre or switch."""
    place, _dot, name = axis.partition(".")
    if "." in name and place != "switch":
        return Setting("device", "*" if place == "node" else place, name)
    if place == "fiber" or "-" in place:
        return Setting("fiber", "" if place == "fiber" else place, name)
    return Setting("switch", "" if place == "switch" else place, name)


def _parameter_of_part(axis: str) -> Parameter:
    """Return the setting of an axis as a parameter; raise BadGrid for one there is not."""
    setting = setting_of(axis)
    if setting.option != "device":
        settings = FIBER if setting.option == "fiber" else SWITCH
        check_names(axis, [setting.name], settings, BadGrid)
        return _of_default(axis, settings[setting.name])
    part, _dot, name = setting.name.partition(".")
    parts: dict[str, Any] = {field.name: field.default for field in fields(Device)}
    check_names(f"{axis}: a device", [part], parts, BadGrid)
    known_fields = {field.name: field for field in fields(parts[part])}
    check_names(f"{axis}: {part}", [name], known_fields, BadGrid)
    declaration = known_fields[name].metadata
    if "choices" in declaration:
        return Parameter(axis, "", choices=tuple(declaration["choices"]))
    return _of_default(axis, getattr(parts[part], name), declaration.get("range"))


def _of_default(name: str, default: object, limits: Any = None) -> Parameter:
    kind = type(default)
    number = kind in (int, float)
    return _number(name, kind, limits, unit_of(name)) if number else Parameter(name, "", text=TEXT)


def options_of(job: str, values: Values, seed: int) -> dict[str, Any]:
    options: dict[str, Any] = {"seed": seed}
    if job not in run_sweep.WHAT:
        options["time"] = STEPPED
    by_option: dict[str, list[str]] = {}
    for name, value in values.items():
        if "." in name:
            setting = setting_of(name)
            by_option.setdefault(setting.option, []).append(setting.word(value))
            if job == "swap" and setting.place == "*" and setting.name in SWITCH:
                by_option.setdefault("switch", []).append(f"{setting.name}={value}")
        elif name in OF_PARTS:
            by_option.setdefault(name, []).extend(str(value).split())
        else:
            options[name] = SWITCHES.get(str(value), value)
    return {**options, **by_option}


def measure(job: str, points: Sequence[Values], seed: int, runs: Path) -> Iterator[Outcome]:
    """Measure points one after the other on one network, with a seed of the first.

    Raise SweepError for all that goes wrong.
    """
    first = points[0]
    own_seed = point_seed(job, first, seed)  # a network beside it has another
    try:
        if job in run_sweep.WHAT:
            names = [each.name for each in grid_of(job, first).experiment.measures]
            for values in points:
                of_point = options_of(job, values, point_seed(job, values, seed))
                yield run_sweep.measure(job, of_point, names, runs)
            return
        with start_for(job, begin_folder(runs, job), **options_of(job, first, own_seed)) as network:
            for values in points:
                yield outcome_of(network.run(job, **options_of(job, values, own_seed)))
    except (NetworkError, TransferError, BadInput, BadTopology, TimeoutError) as error:
        place = ", ".join(f"{name} {str(value)[:MOST_SHOWN]}" for name, value in first.items())
        raise SweepError(f"{job} at {place} and beyond failed: {error}") from error
