"""The start of a network from a script, or from `qmn cli`."""

from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from mininet.topo import Topo

from qmn.jobs.on_network import Made, made_as, network_for
from qmn.machines.options import MACHINES, MachineOptions, machine_facts, machines_of
from qmn.network.checks import check_network
from qmn.network.description import (
    FIBER,
    NetworkDescription,
    describe_network,
    describe_own,
    part_options,
)
from qmn.network.options import NetworkOptions, settings
from qmn.network.topologies import KNOWN, PARAMETERS, is_known
from qmn.options import BadInput, from_keywords
from qmn.results.artifacts import artifacts_of
from qmn.results.pace_row import note_pace
from qmn.results.result import network_facts, note_files
from qmn.results.run_folder import given_at_the_end
from qmn.running.metrics_targets import announce
from qmn.running.network import announce_network
from qmn.scripting.network import QuantumNetwork
from topologies.links.causality import worst
from topologies.networks.network import Signals
from topologies.system.namespaces import with_own_network
from topologies.system.processes.programs import find_tools
from views.live.beside import live_view
from views.live.pages import Pages
from wire.controller_lines import NewFacts
from wire.parameters.checks import remedy
from wire.results.run_result import EarlyNews

NAMED_ONLY = {"preset", *FIBER, *PARAMETERS}  # of the `build` of topologies chosen by name


@contextmanager
def start(
    topo: str | Callable[[], Topo] = "", folder: Path | str | None = None, **options: Any
) -> Iterator[QuantumNetwork]:
    """Start a network, and leave nothing behind at the end; root.

    `topo` is a name that `qmn run` knows, FILE.py:CLASS, or a topology of your own (sdc, unless a
    map is named). Logs and quantum events go into the folder, if there is one. `options` are those
    of NetworkOptions and MachineOptions; what each means, and what it is if absent, says `qmn cli
    --help`. Raise BadInput or BadTopology for what cannot be, NetworkError if it does not start;
    Ctrl-C is a KeyboardInterrupt, and cleans up, too.
    """
    find_tools()
    of_machines = {name: options.pop(name) for name in MACHINES if name in options}
    request = from_keywords(NetworkOptions, options)
    topo = topo or request.topology or "sdc"
    if isinstance(topo, str):
        _require_known(topo)
        description = describe_network(replace(request, topology=topo))
    elif unused := sorted(options.keys() & NAMED_ONLY):
        raise BadInput(f"{unused[0]} is of the topologies of qmn: say it in your own, or leave it")
    else:
        for word in (*request.fiber, *request.node):
            if part_options(request).is_of_all(word):
                raise BadInput(f"{word} is of the topologies of qmn: say of which part it is")
        description = describe_own(topo, request)
    check_network(request)
    with _standing(made_as(description), description, folder, of_machines) as network:
        yield network


@contextmanager
def start_for(
    job: str, folder: Path | str | None = None, **options: Any
) -> Iterator[QuantumNetwork]:
    """Start a network made for a job of `qmn run`, by options of both, on which it can `run`.

    Its topology is that of the job, unless one is named; it has the eavesdropper or the schedule of
    swaps that the job asks for. Otherwise as `start`.
    """
    find_tools()
    of_machines = {name: options.pop(name) for name in MACHINES if name in options}
    needs = network_for(job, options)
    with (
        TemporaryDirectory(prefix="qmn-policy-") as policies,
        _standing(needs.made, needs.description(Path(policies)), folder, of_machines) as network,
    ):
        yield network


@contextmanager
def _standing(
    made: Made, description: NetworkDescription, folder: Path | str | None, machines: dict[str, Any]
) -> Iterator[QuantumNetwork]:
    """Run a network that has been described; `made` is what of it jobs are checked against."""
    where = from_keywords(MachineOptions, machines)
    if not with_own_network():
        description = description.paced_for(
            "it would change the TCP of this machine: start it by `qmn script`"
        )
    description = description.paced_for(*where.against_steps)
    folder = Path(folder) if folder is not None else None
    with (
        running(description, folder, where) as network,
        live_view(False, network.runtime.logs),
    ):
        network.made = replace(made, description=replace(made.description, pace=description.pace))
        yield network


@contextmanager
def running(
    description: NetworkDescription,
    folder: Path | None,
    where: MachineOptions,
    watched: bool = False,
) -> Iterator[QuantumNetwork]:
    """Run a network; a signal that comes while it starts is raised as Interrupted.

    Stepped time of one that is watched never leads the wall.
    """
    options, pace = description.options, description.pace
    with (
        Signals() as signals,
        given_at_the_end(options.keys),
        artifacts_of(options, folder) as facts,
        machines_of(where, description.hosts, folder, signals.check) as places,
    ):
        note_pace(facts, pace)
        runtime = settings(options, folder, pace)
        runtime.places = places
        runtime.watched = watched or Pages.of_command() is not None
        network = QuantumNetwork(description.build, runtime, signals)
        network.made = made_as(description)
        try:
            record = closing(NewFacts(runtime.logs))
            with record as network.record, network, signals.at_once():
                if places:
                    facts.machines = machine_facts(runtime)
                facts.network = network_facts(network)
                announce_network(network.runtime, facts)
                early = worst(network.runtime)
                facts.acausal = EarlyNews(*early) if early else None
                if folder is not None and options.metrics:
                    facts.metrics = announce(runtime.metrics_addresses, folder)
                yield network
        finally:
            note_files(facts, network)


def _require_known(topology: str) -> None:
    """Raise BadInput for a name that is none of a topology."""
    if not is_known(topology):
        text = remedy(topology, KNOWN)
        if "," in topology:
            text = "give its parameters as keywords, as in start('chain', switches=3)"
        raise BadInput(f"unknown topology {topology!r}: {text}")
