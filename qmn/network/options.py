"""Options of a network before it starts: the same for `qmn run`, `qmn cli` and scripts.

The command line has them as options, Python as keywords: --length-km 2 and length_km=2.
"""

import argparse
import socket
from collections.abc import Mapping
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NoReturn, TypedDict

from controller_apps.policy.policy import BadPolicy, read_policy
from qmn.network.time_scale import AUTO, REAL, scale
from topologies.copper_link import MOST_KM
from topologies.node_kinds import NODE_KINDS
from topologies.presets import PRESETS
from topologies.runtime import OPENFLOW_PORT, Runtime
from wire.config import BACKENDS, CONTENTION
from wire.parameters.fiber import KINDS


class BadInput(Exception):
    """What the user asked for cannot be done; the text names value and remedy."""


class NetworkOptions(TypedDict, total=False):
    """The keywords of scripts; `qmn cli --help` says what each means and what it is if absent."""

    seed: int
    time_scale: float | str
    backend: str
    sabot: str
    controller: str
    openflow_port: int
    preset: str
    length_km: float
    loss_db_per_km: float
    depolarizing: float
    kind: str
    fiber: list[str]  # as burst_end_hz=10, or q1-q2.length_km=40
    switch: list[str]  # as q1.insertion_loss_db=1.2
    node: list[str]  # as ion-trap, or bob=ion-trap
    device: list[str]  # as bob.detectors.efficiency=0.8
    switches: int
    leaves: int
    repeaters: int
    spines: int
    copper_km: float
    control_km: float
    control_loss: float
    loss_budget_db: float
    contention: str
    policy: str | Path
    rest: str
    apps: list[str]
    keys: str | Path
    metrics: bool
    history_depth: int
    per_qubit: int


def add_network_options(parser: argparse.ArgumentParser) -> None:
    """Describe the options."""
    add = partial(parser.add_argument)
    add("--seed", type=int, default=1, help="of all quantum randomness (1)")
    text = f"one second of the network takes K seconds here ({REAL}; {AUTO}: as slowly as it needs)"
    add("--time-scale", type=scale, default=REAL, metavar="K", help=text)
    add("--backend", choices=BACKENDS, default="chp", help="simulates quantum states (chp)")
    add("--sabot", default="", metavar="SOCKET", help="simulate in a Sabot server (in ed itself)")
    add("--controller", choices=["ryu", "os-ken"], default="ryu", help="default: ryu")
    add("--openflow-port", type=int, default=OPENFLOW_PORT, metavar="PORT", help="of c0 (6653)")
    add("--preset", choices=list(PRESETS), default="ideal", help="fibres and devices (ideal)")
    what_of = "of every fibre"
    add("--length-km", type=float, metavar="KM", help=f"{what_of} (0.01)")
    add("--loss-db-per-km", type=float, metavar="DB", help=f"{what_of} (0)")
    text = f"{what_of}: X, Y and Z each with probability P/4 (0)"
    add("--depolarizing", type=float, metavar="P", help=text)
    text = f"{what_of}: standard or polarisation-maintaining"
    add("--kind", choices=list(KINDS), help=text)
    text = f"{what_of}, as burst_end_hz=10, or of those between two nodes, as q1-q2.length_km=40 "
    text += "(repeatable; docs/physical-layer.md)"
    add("--fiber", action="append", default=[], metavar="[A-B.]NAME=VALUE", help=text)
    text = "of every quantum switch, as insertion_loss_db=1.2, or of one, as q1.insertion_loss_db=1"
    add("--switch", action="append", default=[], metavar="[NAME.]NAME=VALUE", help=text)
    kinds = " or ".join(NODE_KINDS)
    text = f"what all hosts are, or one: {kinds} (repeatable; docs/nodes.md)"
    add("--node", action="append", default=[], metavar="[HOST=]KIND", help=text)
    text = "of a host, as bob.detectors.efficiency=0.8 (repeatable; docs/physical-layer.md)"
    add("--device", action="append", default=[], metavar="HOST.PART.NAME=VALUE", help=text)
    add("--repeaters", type=int, metavar="N", help="of a chain of them, 1 to 16")
    add("--switches", type=int, metavar="N", help="quantum switches of a chain or ring")
    add("--leaves", type=int, metavar="N", help="switches of leaf-spine with hosts (3)")
    add("--spines", type=int, metavar="N", help="switches of leaf-spine between leaves (2)")
    text = "length of every copper cable (that of the fibres between the same places)"
    add("--copper-km", type=float, metavar="KM", help=text)
    text = "length of the copper between c0 and every switch (as other copper)"
    add("--control-km", type=float, metavar="KM", help=text)
    text = "share of the packets between c0 and every switch that are lost (0)"
    add("--control-loss", type=float, default=0.0, metavar="P", help=text)
    add("--loss-budget-db", type=float, default=30.0, metavar="DB", help="of a light path (30)")
    add("--contention", choices=CONTENTION, default="refuse", help="if light is taken")
    add("--policy", type=Path, metavar="FILE", help="who may do what, in TOML (allow everything)")
    add("--rest", default="", metavar="ADDRESS", help="serve what c0 knows there, over HTTP")
    text = "load a controller app beside ours, such as ryu.app.ofctl_rest (more than once)"
    add("--app", dest="apps", action="append", default=[], metavar="MODULE", help=text)
    parser.set_defaults(keys=None)
    add("--metrics", action="store_true", help="figures for Prometheus (docs/metrics.md)")
    add("--history-depth", type=int, default=10_000, metavar="N", help="events kept (10000)")
    text = "write an event for each of the first N photons of a block (1000), too"
    add("--per-qubit", type=int, nargs="?", const=1000, default=0, metavar="N", help=text)


def add_key_folder(parser: argparse.ArgumentParser) -> None:
    """Describe where keys stay, for networks over which keys may be distributed."""
    text = "keep the keys that hosts make here, a new folder (they go with the network)"
    parser.add_argument("--keys", type=Path, metavar="DIR", help=text)


class _Parser(argparse.ArgumentParser):
    """A parser that raises BadInput where it would end the program."""

    def error(self, message: str) -> NoReturn:
        raise BadInput(message)


def from_keywords(options: Mapping[str, Any]) -> argparse.Namespace:
    """Return what the command line would say; raise BadInput for what it would not take."""
    parser = _Parser(allow_abbrev=False, add_help=False)
    add_network_options(parser)
    add_key_folder(parser)
    words = []
    for name, value in options.items():
        option = "--app" if name == "apps" else f"--{name.replace('_', '-')}"
        if isinstance(value, bool):
            words += [option] * value
        else:
            values = value if isinstance(value, list) else [value]
            words += [f"{option}={each}" for each in values]
    return parser.parse_args(words)


def check_range(arguments: argparse.Namespace, name: str, least: float, most: float) -> None:
    """Raise BadInput unless the option of this name is in its range."""
    value = getattr(arguments, name)
    if not least <= value <= most:
        raise BadInput(f"--{name.replace('_', '-')} {value}: choose {least:g} to {most:g}")


def check_network(arguments: argparse.Namespace) -> None:
    """Raise BadInput for what controller or dispatcher would not take."""
    if arguments.policy is not None:
        try:
            read_policy(arguments.policy)
        except BadPolicy as error:
            raise BadInput(str(error)) from error
    if arguments.sabot and not Path(arguments.sabot).is_socket():
        raise BadInput(
            f"--sabot {arguments.sabot}: no server listens there; start one with "
            f"python -m dispatcher.sabot --socket {arguments.sabot}"
        )
    if arguments.rest and arguments.controller != "ryu":
        raise BadInput(f"--rest needs --controller ryu: {arguments.controller} has no HTTP server")
    if arguments.rest:
        check_address(arguments.rest)
    for module in arguments.apps:
        check_module(module)
    if arguments.keys is not None and arguments.keys.exists():
        raise BadInput(f"--keys {arguments.keys} exists: name a new folder for each network")
    check_range(arguments, "openflow_port", 1, 65_535)
    check_range(arguments, "history_depth", 0, 10_000_000)
    check_range(arguments, "per_qubit", 0, 1_000_000)
    check_range(arguments, "loss_budget_db", 0, 1_000)
    if arguments.copper_km is not None:
        check_range(arguments, "copper_km", 0, MOST_KM)
    if arguments.control_km is not None:
        check_range(arguments, "control_km", 0, MOST_KM)
    check_range(arguments, "control_loss", 0, 0.9)


def check_address(text: str) -> None:
    """Raise BadInput for an address of --rest at which nobody can listen."""
    host, colon, port = text.rpartition(":")
    if not (host and colon and port.isascii() and port.isdigit() and 0 < int(port) < 1 << 16):
        raise BadInput(f"--rest {text}: write ADDRESS:PORT, as 127.0.0.1:8080")
    try:
        socket.create_server((host, int(port))).close()
    except OSError as error:
        raise BadInput(f"--rest {text}: cannot listen there: {error.strerror}") from error


def check_module(name: str) -> None:
    """Raise BadInput for a module of --app that is not there."""
    try:
        found = find_spec(name)
    except (ImportError, ValueError):
        found = None  # what it would be a part of is not there
    if found is None:
        raise BadInput(f"--app {name}: there is no such module; name one as Python imports it")


def check_two_hosts(sender: str, receiver: str, hosts: list[str]) -> None:
    """Raise BadInput unless both are of these hosts, and not the same."""
    for name in (sender, receiver):
        if name not in hosts:
            raise BadInput(f"unknown host {name!r}: choose one of {', '.join(hosts)}")
    if sender == receiver:
        raise BadInput(f"sender and receiver are both {sender}: choose two hosts")


def settings(
    arguments: argparse.Namespace,
    folder: Path | None,
    time_scale: float,
    record: bool = False,
    qasm: bool = False,
    events: bool = True,
) -> Runtime:
    """Return the settings of a network that leaves its logs in a folder; None: leaves none."""
    return Runtime(
        seed=arguments.seed,
        time_scale=time_scale,
        backend=arguments.backend,
        sabot=arguments.sabot and str(Path(arguments.sabot).resolve()),
        record=record,
        qasm=qasm,
        events=events,
        per_qubit=arguments.per_qubit,
        framework=arguments.controller,
        openflow_port=arguments.openflow_port,
        copper_km=arguments.copper_km,
        control_km=arguments.control_km,
        control_loss=arguments.control_loss,
        history_depth=arguments.history_depth,
        loss_budget_db=arguments.loss_budget_db,
        contention=arguments.contention,
        log_folder=folder,
        policy=str(arguments.policy.resolve()) if arguments.policy else "",
        rest=arguments.rest,
        apps=arguments.apps,
        metrics=arguments.metrics,
        keys=str(arguments.keys.resolve()) if arguments.keys else "",
    )
