"""qmn cli TOPOLOGY: start a network and steer it from Mininet's command line, with quantum verbs.

Commands come from the keyboard, or from a file: qmn cli sdc < commands
"""

import argparse
import io
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from qmn.machines.options import MachineOptions
from qmn.needs import Needs
from qmn.network.checks import check_network
from qmn.network.custom_topology import BadTopology, short_name
from qmn.network.description import describe_network
from qmn.network.options import NetworkOptions
from qmn.network.programs import NetworkProgram, Start
from qmn.network.time_scale import PACED
from qmn.network.topologies import TakeTopology, described_topologies, topology
from qmn.options import BadInput, add_options, read
from qmn.requests.run_options import CAPTURES, LiveOptions
from qmn.results import pace_row, schema
from qmn.results.run_folder import begin_folder, give_to_invoker
from qmn.running.metrics_targets import urls
from qmn.scripting import QuantumNetwork, running
from topologies.networks.network import Interrupted
from topologies.networks.requirements import require_free
from topologies.system.processes.programs import NetworkError
from topologies.system.processes.signals import interrupted_words
from views.live.beside import live_view
from wire.parameters.option import WRITTEN, option
from wire.registered import PROGRAMS, Registry

INTERRUPTED = 130  # status of a script that Ctrl-C has ended, as of a shell


def add_parser(verbs: Any) -> None:
    parser = verbs.add_parser(
        "cli",
        usage="qmn cli TOPOLOGY [options]",
        description=__doc__,
        epilog=described_topologies(),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    text = "one of those below, with parameters as in chain,5, or your own, as FILE.py:CLASS"
    parser.add_argument(
        "topology", action=TakeTopology, type=topology, metavar="TOPOLOGY", help=text
    )
    add_options(parser, NetworkOptions)  # keys, too: a program on a host may distribute some
    for program in programs():
        add_options(parser, program.options)
    add_options(parser, MachineOptions)
    add_options(parser, CliOptions, group=WRITTEN)
    parser.set_defaults(call=call, needs=Needs.NETWORK)


def programs() -> list[NetworkProgram]:
    return list(Registry(PROGRAMS, lambda each: isinstance(each, NetworkProgram), {}).values())


def call(arguments: argparse.Namespace) -> int:
    """Start, obey, clean up; turn every fault into one line and an exit status."""
    try:
        beside = [(program, read(program.options, arguments)) for program in programs()]
        options, where = read(NetworkOptions, arguments), read(MachineOptions, arguments)
        return start_and_obey(options, beside, where, read(CliOptions, arguments))
    except (BadInput, BadTopology, NetworkError) as error:
        print(f"qmn: {error}", file=sys.stderr)
        return 1
    except (Interrupted, KeyboardInterrupt) as error:
        print(f"qmn: {interrupted_words(error)}", file=sys.stderr)
        return error.status if isinstance(error, Interrupted) else INTERRUPTED


@dataclass(frozen=True, kw_only=True)
class CliOptions(LiveOptions):
    runs: Path = option(Path("runs"), "where logs go (runs)", metavar="DIR")
    captures: str = option(
        "none",
        "capture packets in full, their headers (first 640 bytes), or none (none)",
        choices=CAPTURES,
    )


def start_and_obey(
    options: NetworkOptions,
    beside: Sequence[tuple[NetworkProgram, Any]],
    where: MachineOptions,
    extras: CliOptions,
) -> int:
    """Return the exit status: of a script 1 if a command has failed."""
    for program, chosen in beside:
        options = program.network(chosen, options)
    check_network(options)
    options = replace(options, time=options.time or PACED)
    description = describe_network(options).paced_for(*where.against_steps)
    starts = [program.prepare(chosen, description.hosts) for program, chosen in beside]
    require_free(description.topo)
    folder = begin_folder(extras.runs, short_name(options.topology))
    try:
        print(f"starting the network; its logs and quantum events: {folder}", flush=True)
        with running(description, folder, where, watched=True) as network:
            if packet_bytes := CAPTURES[extras.captures]:
                switches = network.copper_switches
                network.capture(*switches, openflow=True, packet_bytes=packet_bytes)
            start_beside(network, [start for start in starts if start is not None])
            with live_view(extras.live, folder, for_all=extras.live_for_all):
                status = obey(network)
        for name, text in pace_row.rows(schema.read_left(folder)).items():
            print(f"{name}: {text}")
        return status
    finally:
        give_to_invoker(folder)


def start_beside(network: QuantumNetwork, starts: Sequence[Start]) -> None:
    for switch, address in network.runtime.gnmi_addresses.items():
        print(f"gNMI of {switch}: {address}")
    for program, url in urls(network.runtime.metrics_addresses).items():
        print(f"metrics of {program}: {url}", flush=True)
    for start in starts:
        for name, address in start(network).items():
            print(f"{name}: {address}", flush=True)


def obey(network: QuantumNetwork) -> int:
    """Do what comes from the keyboard, or all of a script."""
    # Loading Mininet's command line takes a moment: other verbs do not wait for it.
    from qmn.interactive.quantum_cli import QuantumCLI

    if sys.stdin.isatty():
        QuantumCLI(network)
        return 0
    assert isinstance(sys.stdin, io.TextIOWrapper)
    sys.stdin.reconfigure(errors="replace")  # a line that is not UTF-8 is one that fails
    return 1 if QuantumCLI(network, script=sys.stdin).failures else 0
