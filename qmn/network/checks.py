"""Checks of what a user says of a network, before anything starts."""

from collections.abc import Collection, Sequence
from importlib.util import find_spec
from pathlib import Path

from qmn.network.options import NetworkOptions
from qmn.options import BadInput, check_ranges
from qmn.project import remedy as remedy_of
from topologies.system.namespaces import machine_listener
from wire.parameters.checks import NEAR, remedy
from wire.parameters.network import FRAMEWORKS
from wire.registered import CLICK_OBSERVERS, SIMULATIONS, TELEMETRY, BadPackage, only

FROM_TO, LINE = "--from and --to", "--line"  # by which a user says who takes part


def check_network(options: NetworkOptions) -> None:
    """Raise BadInput for what controller or dispatcher would not take."""
    options.by_policy()
    if options.sabot and not Path(options.sabot).is_socket():
        raise BadInput(
            f"--sabot {options.sabot}: no server listens there; start one with "
            f"python -m dispatcher.sabot --socket {options.sabot}"
        )
    check_framework(options.controller)
    if options.rest and options.controller != "ryu":
        raise BadInput(f"--rest needs --controller ryu: {options.controller} has no HTTP server")
    if options.rest:
        check_address(options.rest)
    for module in options.apps:
        check_module(module)
    if options.keys and Path(options.keys).exists():
        raise BadInput(f"--keys {options.keys} exists: name a new folder for each network")
    try:
        for option, group in (
            ("gnmi", TELEMETRY),
            ("tags", CLICK_OBSERVERS),
            ("sabot", SIMULATIONS),
        ):
            if getattr(options, option):
                only(f"--{option}", group)
    except BadPackage as error:
        raise BadInput(str(error)) from error
    if options.tags and Path(options.tags).exists():
        raise BadInput(f"--tags {options.tags} exists: name a new folder for each network")
    if options.tags and not (parent := Path(options.tags).absolute().parent).is_dir():
        raise BadInput(f"--tags {options.tags}: there is no folder {parent}; make it before")
    clocks = [word for word in options.device if ".detectors.clock_" in word]
    if clocks and not options.tags:
        raise BadInput(f"--device {clocks[0]} is of time tags: say --tags, or leave it out")
    if options.tags and find_spec("pyarrow") is None:
        raise BadInput("--tags writes Parquet by pyarrow, which is missing: pip install pyarrow")
    check_ranges(options)


def check_framework(name: str) -> None:
    """Raise BadInput if the framework of the controller is not installed."""
    package = name.replace("-", "_")
    if find_spec(package) is None:
        why = remedy_of(ModuleNotFoundError(name=package)) or f"{package} is not installed"
        others = " or ".join(framework for framework in FRAMEWORKS if framework != name)
        raise BadInput(f"--controller {name}: {why} (docs/packages.md), or choose {others}")


def check_address(text: str) -> None:
    """Raise BadInput for an address of --rest at which nobody can listen."""
    host, colon, port = text.rpartition(":")
    if not (host and colon and port.isascii() and port.isdigit() and 0 < int(port) < 1 << 16):
        raise BadInput(f"--rest {text}: write ADDRESS:PORT, as 127.0.0.1:8080")
    try:
        machine_listener(host, int(port)).close()
    except OSError as error:
        raise BadInput(f"--rest {text}: cannot listen there: {error.strerror}") from error


def check_module(name: str) -> None:
    """Raise BadInput for a module of --app that is not there."""
    try:
        spec = find_spec(name)
    except (ImportError, ValueError):
        spec = None  # what it would be a part of is not there
    if spec is None:
        raise BadInput(f"--app {name}: there is no such module; name one as Python imports it")


def check_two_hosts(
    sender: str,
    receiver: str,
    hosts: Sequence[str],
    dark: Collection[str] = (),
    said_by: str = "",
) -> None:
    """Raise BadInput unless both are of these hosts, and not the same; `dark` have no light.

    `said_by` names the options by which a user says them, if there are any.
    """
    by = f" by {said_by}" if said_by else ""
    choice = f"choose two of {', '.join(hosts)}{by}"
    if not hosts:
        choice = "there is none here: see examples/my_net.py"
    for name in (sender, receiver):
        if name in dark:
            raise BadInput(
                f"host {name!r} has no light: only a host of cls=QuantumHost has; {choice}"
            )
        if name not in hosts:
            near = remedy(name, hosts)
            raise BadInput(f"unknown host {name!r}: {near if near.startswith(NEAR) else choice}")
    if sender == receiver:
        raise BadInput(f"sender and receiver are both {sender}: choose two hosts")
