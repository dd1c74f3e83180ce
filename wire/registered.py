"""The door of packages: what they register by entry points (docs/architecture.md).

The metadata of an installed package has them, or a folder NAME.dist-info beside a package. The core
imports no such package by name.
"""

import logging
from collections.abc import Callable, Collection, Iterator, Mapping
from functools import cache, cached_property
from importlib.metadata import EntryPoint, EntryPoints, entry_points
from typing import Any, TypeVar

VERBS = "qmn.verbs"  # by heading, verb: module and help
JOBS = "qmn.jobs"  # of `qmn run`: a module with HELP and describe(parser)
SERVICE_VERBS = "qmn.service_verbs"  # qmn.requests.service_verbs.Verb, by its name
STANDING_JOBS = "qmn.standing_jobs"  # makes a qmn.jobs.on_network.Planned
REQUESTS = "qmn.requests"  # dataclass of a request, by the service that a result names
PROGRAMS = "qmn.programs"  # qmn.network.programs.NetworkProgram, for `qmn cli`
DISSECTORS = "qmn.dissectors"  # a module with LUA, a script, and tables() that it reads
CLICK_OBSERVERS = "qmn.click_observers"  # begins to observe: of DispatcherConfig and time (ns)
TELEMETRY = "qmn.telemetry"  # what serves that of a quantum switch: of AgentConfig and Switch
SIMULATIONS = "qmn.simulations"  # dispatcher.sabot.simulation.Simulation, of socket and backend
SIMULATION_SERVERS = "qmn.simulation_servers"  # serves such a socket, with at most N qubits
INSTRUMENTS = "qmn.instruments"  # by scheme of an address: driver of an AgentConfig
DATAGRAMS = "qmn.datagrams"  # a class of wire.metadata.header.Message: wire.device carries it
HARDWARE = "qmn.hardware"  # a class of hosts.hardware.qnic.Qnic
NOISE = "qmn.noise"  # a class with a method effect
TOPOLOGIES = "qmn.topologies"  # a class of mininet.topo.Topo
JOB = "the job"  # group of a job's own options

T = TypeVar("T")
log = logging.getLogger("packages")


class BadPackage(ImportError):
    """An entry point that cannot be used; the text names it, its value and why."""


@cache
def _selection() -> Callable[..., EntryPoints]:
    """Return what selects from all entry points: to look for them takes 14 ms."""
    return entry_points().select


def registered(group: str, taken: Collection[str] = ()) -> dict[str, EntryPoint]:
    """Return the entry points of a group by name; raise ImportError for a name that is taken."""
    entries = sorted(_selection()(group=group), key=lambda each: each.name)
    named = {entry.name: entry for entry in entries}
    if len(named) < len(entries):
        values = ", ".join(entry.value for entry in entries)
        raise ImportError(f"two entry points of {group} have the same name: {values}; remove one")
    if clashes := [f"{name} ({named[name].value})" for name in named if name in taken]:
        raise ImportError(f"{group}: {', '.join(clashes)}: qmn has this name itself; rename it")
    return named


def only(option: str, group: str) -> EntryPoint:
    """Return the one entry point that an option needs; raise BadPackage for none or several."""
    entries = [*registered(group).values()]
    if len(entries) != 1:
        values = ", ".join(entry.value for entry in entries)
        remedy = f"keep one of {values}" if entries else "install one"
        raise BadPackage(f"{option}: one package provides {group}: {remedy}")
    return entries[0]


def load(entry: EntryPoint, fits: Callable[[Any], bool] = lambda _value: True) -> Any:
    """Return what an entry point names; raise BadPackage if it cannot be had or does not fit."""
    where = f"{entry.name} ({entry.value})"
    try:
        value = entry.load()
    except Exception as error:  # it is another's program, which may raise any
        raise BadPackage(f"{where} is left out: {type(error).__name__}: {error}") from error
    if not fits(value):
        raise BadPackage(f"{where} is left out: {value!r} is none of {entry.group}")
    return value


class Registry(Mapping[str, T]):
    """Values of qmn by name, and those that packages add: they are loaded at the first look.

    One that cannot be used is logged and left out; a name that is taken is an ImportError.
    """

    def __init__(self, group: str, fits: Callable[[Any], bool], members: Mapping[str, T]) -> None:
        self._group, self._fits, self._own = group, fits, members

    @cached_property
    def _all(self) -> dict[str, T]:
        values = dict(self._own)
        for name, entry in registered(self._group, self._own).items():
            try:
                values[name] = load(entry, self._fits)
            except BadPackage as error:
                log.warning("%s: %s", self._group, error)
        return values

    def __getitem__(self, name: str) -> T:
        return self._all[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._all)

    def __len__(self) -> int:
        return len(self._all)
