"""The context of a run of any kind: its folder, its network, its facts, its end."""

import argparse
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

from rich.console import Console

from qmn.jobs.transfer import TransferError
from qmn.live.dispatcher_calls import status
from qmn.live.metrics_targets import announce
from qmn.network.custom_topology import BadTopology, short_name
from qmn.network.device_options import differences
from qmn.network.options import BadInput, check_range, settings
from qmn.network.time_scale import scale_of
from qmn.network.topologies import quantum_hosts, stated_devices, stated_optics, topology
from qmn.reports.report_file import report_of_run
from qmn.results.network_facts import network_facts
from qmn.results.run_folder import give_to_invoker, given_at_the_end, make_folder, point_latest
from qmn.results.software_share import software_facts
from qmn.results.timeline import timeline_of_run
from topologies.causality import worst
from topologies.network import Interrupted, Network, Signals
from topologies.programs import NetworkError
from topologies.slow_copper import LEAST_MBPS, MOST_MBPS, slow_metadata

NETWORK_PARAMETERS = (
    "preset",
    "length_km",
    "loss_db_per_km",
    "depolarizing",
    "kind",
    "fiber",
    "switch",
    "node",
    "device",
    "switches",
    "leaves",
    "repeaters",
    "spines",
    "copper_km",
    "control_km",
    "control_loss",
    "loss_budget_db",
    "contention",
    "openflow_port",
    "classical_mbps",
)

Work = Callable[[argparse.Namespace, Signals, Console], int]
Complete = Callable[[dict[str, Any], Path], None]


def add_run_options(parser: argparse.ArgumentParser) -> None:
    """Describe what every run can be told of what it leaves behind."""
    add = partial(parser.add_argument)
    add("--runs", type=Path, default=Path("runs"), metavar="DIR", help="what runs leave (runs)")
    text = "slow classical channel: Mbit/s of quantum metadata that a host can send (no limit)"
    add("--classical-mbps", type=float, metavar="MBPS", help=text)
    add("--qasm", action="store_true", help="write what is done to qubits to quantum.qasm")
    add("--no-capture", action="store_true", help="do not capture packets")
    add("--no-events", action="store_true", help="do not write what happens to qubits")
    add("--no-record", action="store_true", help="do not record what `qmn replay` needs")


def check_run(arguments: argparse.Namespace) -> None:
    """Raise BadInput for what no run can be told."""
    if arguments.classical_mbps is not None:
        check_range(arguments, "classical_mbps", LEAST_MBPS, MOST_MBPS)


def guarded(work: Work, arguments: argparse.Namespace) -> int:
    """Do the work; turn every fault into one line and an exit status."""
    try:
        with Signals() as signals:
            return work(arguments, signals, Console(highlight=False))
    except (BadInput, BadTopology, NetworkError, TransferError) as error:
        tell(str(error), error)
        return 1
    except Interrupted as error:
        tell(f"{error}; everything is cleaned up", error)
        return error.status


def tell(words: str, error: Exception) -> None:
    """Print what ended the work, and what is left of it to look at."""
    print(f"qmn: {words}", *getattr(error, "__notes__", ()), sep="\n", file=sys.stderr)


def begin_folder(runs: Path, name: str) -> Path:
    """Return the new folder of a run; raise BadInput if it cannot be made."""
    try:
        folder = make_folder(runs, short_name(name))
    except OSError as error:
        raise BadInput(f"cannot write to --runs {runs}: {error.strerror}") from error
    point_latest(folder)
    return folder


def known_facts(arguments: argparse.Namespace, own: Sequence[str]) -> dict[str, Any]:
    """Return the facts that are known before the start; `own` are parameters of this kind."""
    return {
        "topology": arguments.topology,
        "mode": os.environ.get("QMN_MODE", "native"),
        "controller": arguments.controller,
        "seed": arguments.seed,
        "parameters": {
            name: getattr(arguments, name)
            for name in (*own, *NETWORK_PARAMETERS)
            if getattr(arguments, name) is not None
        },
        "optics": stated_optics(arguments),
        "devices": {
            host: differences(device) for host, device in stated_devices(arguments).items()
        },
        "captures": [],
        "events": not arguments.no_events,
        "backend": arguments.backend,
        "exact": None,
    }


@contextmanager
def running_network(
    arguments: argparse.Namespace,
    folder: Path,
    facts: dict[str, Any],
    signals: Signals,
    console: Console,
) -> Iterator[Network]:
    """Run a network with its captures, and add to the facts."""
    topo = topology(arguments)
    chosen = scale_of(arguments.time_scale, topo)
    runtime = settings(
        arguments,
        folder,
        chosen.scale,
        record=not arguments.no_record,
        qasm=arguments.qasm,
        events=not arguments.no_events,
    )
    facts["time_scale"], facts["time_scale_because"] = chosen.scale, chosen.reason or None
    console.print(f"starting the network ({arguments.controller}, seed {arguments.seed}) ...")
    if chosen.reason:
        console.print(f"time scale {chosen.scale:g}: {chosen.reason}")
    with (
        given_at_the_end(arguments.keys),
        Network(
            topo, runtime, signals, lambda cause: console.print(f"ending: {cause}", soft_wrap=True)
        ) as network,
    ):
        facts["network"] = network_facts(network).to_dict()
        facts["backend"] = status(network).backend
        if arguments.classical_mbps is not None:
            for host in quantum_hosts(network.net.topo):
                slow_metadata(network.host(host), arguments.classical_mbps / chosen.scale)
        if arguments.metrics:
            facts["metrics"] = urls = announce(runtime.metrics_addresses, folder)
            for program, url in urls.items():
                console.print(f"figures of {program}: {url}", soft_wrap=True)
        if not arguments.no_capture:
            files = [*network.capture("s1"), network.capture_openflow()]
            facts["captures"] = [str(file) for file in files]
        yield network
        reached = status(network)
        facts["exact"] = reached.exact
        early = worst(network.runtime)
        facts["acausal"] = early.to_dict() if early else None
        facts |= software_facts(reached.software, network.runtime.devices.values())
    facts["packets_not_captured"] = network.packets_missed


@contextmanager
def ending(folder: Path, facts: dict[str, Any], complete: Complete) -> Iterator[None]:
    """Leave timeline, facts and report behind, whatever happens inside.

    What ends the run tells where the report is.
    """
    fault: Exception | None = None
    try:
        yield
    except (NetworkError, TransferError, Interrupted) as error:
        fault = error
        facts["error"] = str(error)
        raise
    finally:
        facts["timeline"] = timeline_of_run(folder)
        complete(facts, folder)
        facts["report"] = report_of_run(folder)
        if fault is not None:
            fault.add_note(f"report to look at: {facts['report']}")
        give_to_invoker(folder)
