"""The job of a NetQASM application: its programs run on hosts, as they are, and return something.

A folder has a program app_ROLE.py for each role, and perhaps its inputs in ROLE.yaml and the host
of each role in roles.yaml, as NetQASM's own `netqasm simulate` wants it; nodes there that are no
hosts, and its network.yaml, are of a network that does not run. A file is a NetQMPI
program of all ranks, whose roles are rank_0, rank_1, ...
"""

import json
import shutil
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import yaml
from rich.console import Console

from applications.netqasm.carried import CarriedApplication
from applications.netqasm.folder import check_inputs, left_out, read_yaml
from applications.netqasm.request import NetqasmRequest
from qmn.jobs.obstacle import lost_light
from qmn.jobs.run_context import RunContext, ending, known_facts, running_network
from qmn.jobs.transfer import TransferError, follow_all
from qmn.network.checks import check_network
from qmn.network.description import describe_network
from qmn.network.felt_settings import checked_settings, everything
from qmn.options import BadInput, check_ranges
from qmn.results import result
from qmn.results.run_folder import begin_folder
from qmn.timeouts import NETQASM_STALL_TIMEOUT_S
from topologies.networks.network import Network, Signals
from topologies.networks.requirements import require_free
from topologies.system.processes.programs import NetworkError, Program, python
from wire.network_time import SteppedTime
from wire.parameters.checks import remedy
from wire.results.run_result import NetqasmJob, Round
from wire.results.time_series import Line

PREFIX, SUFFIX = "app_", ".py"
RANK = "rank_"  # as NetQMPI calls its roles
MOST_SHOWN = 3  # rounds


@dataclass(frozen=True)
class Application:
    """A program to run: hosts and inputs by role."""

    path: Path
    hosts: Mapping[str, str]
    inputs: Mapping[str, Mapping[str, Any]]
    rounds: int
    notes: Sequence[str] = ()  # about files that are not applied


def run(request: NetqasmRequest, signals: Signals, console: Console) -> int:
    description = describe_network(
        replace(request.network, state_inspection=request.state_inspection)
    )
    request = with_machines(request, description.hosts)
    application = checked(request, description.hosts)
    description = description.paced_for(*request.run.against_steps)
    making_pairs = (description.parts.source_for(host) for host in application.hosts.values())
    felt = everything({*application.hosts.values(), *filter(None, making_pairs)})
    description = checked_settings("netqasm", felt, description)
    for note in application.notes:
        console.print(note)
    require_free(description.topo)
    folder = begin_folder(request.run.runs, "netqasm")
    context = RunContext(description, request.run, folder, signals, console)
    request = replace(request, path=application.path)
    played = NetqasmJob(roles=dict(application.hosts))
    hosts = list(application.hosts.values())
    facts = known_facts(context, "netqasm", hosts, played, request)
    copies = CarriedApplication(application.path, hosts, request.run.runs)
    with (
        ending(folder, facts, result.complete, context.options.report) as ended,
        running_network(context, facts, copies.prepare) as network,
        lost_light(network, console) as lost,
    ):
        console.print(f"{application.path.name}: {assigned(application.hosts)}")
        play(application, copies, network, folder, played.outputs, lost.look)
        facts.delivered = True
    of_every_run = result.rows_of_every_run(facts, folder, ended.report)
    result.print_rows(console, {**rows(played.outputs), **of_every_run})
    return 0


def with_machines(request: NetqasmRequest, hosts: Sequence[str]) -> NetqasmRequest:
    """Return the request with places of hosts on machines where those of other jobs are.

    Over several machines HOST=MACHINE is a place of a host, unless a host is called MACHINE.
    """
    if request.run.machines == 1:
        return request
    ways = {word: word.partition("=") for word in request.place}
    of_hosts = [word for word, (one, _, to) in ways.items() if one in hosts and to not in hosts]
    of_roles = [word for word in request.place if word not in of_hosts]
    run = replace(request.run, place=tuple(of_hosts))
    return replace(request, place=tuple(of_roles), run=run)


def checked(request: NetqasmRequest, hosts: Sequence[str]) -> Application:
    """Return the application on some of these hosts; raise BadInput before anything is started."""
    check_network(request.network)
    check_ranges(request.run)
    check_ranges(request)
    roles, folder = roles_of(request.path, request.ranks), request.path.resolve()
    if request.path.is_file():
        folder = folder.parent
        if request.input:
            raise BadInput("--input: NetQMPI gives its programs none; write it into the program")
    inputs = {role: read_yaml(folder / f"{role}.yaml") for role in roles}
    for role, name, value in map(_input, request.input):
        _require(role, roles, "--input")
        inputs[role][name] = value
    path, nodes = request.path.resolve(), read_yaml(folder / "roles.yaml")
    if path.is_dir():
        for role in roles:
            check_inputs(path / f"{PREFIX}{role}{SUFFIX}", role, inputs[role])
    of_file = {role: node for role, node in nodes.items() if node in hosts or role not in roles}
    places = placement(roles, {**of_file, **dict(map(_placed, request.place))}, hosts)
    notes = [*_other_nodes(nodes, of_file, places), *_other_network(folder / "network.yaml")]
    return Application(path, places, inputs, request.rounds, notes)


def _other_nodes(
    nodes: Mapping[str, Any], of_file: Mapping[str, Any], places: Mapping[str, str]
) -> list[str]:
    """Return a note about nodes of roles.yaml that are no hosts: nodes of a simulator's network."""
    others = {role: node for role, node in nodes.items() if role not in of_file}
    if not others:
        return []
    instead = assigned({role: places[role] for role in others})
    return [f"roles.yaml: there is no host {', '.join(map(str, others.values()))}; {instead}"]


def _other_network(file: Path) -> list[str]:
    """Return a note about a simulator's network, in the place of which ours runs."""
    if not file.exists():
        return []
    if noise := left_out(file):
        text = f"{', '.join(noise)}; set noise by --depolarizing and --device"
    else:
        text = "it is ideal; hosts and fibres are those of --topology"
    return [f"network.yaml is not applied: {text}"]


def roles_of(path: Path, ranks: int | None) -> list[str]:
    """Return the roles of the application in a folder, or of a program of a number of ranks.

    Raise BadInput if there is none.
    """
    if not path.exists():
        raise BadInput(f"there is no {path}: name an application's folder, or a NetQMPI program")
    if path.is_file():
        if path.suffix != SUFFIX or ranks is None:
            text = "it is FILE.py, and --ranks says on how many hosts it runs"
            raise BadInput(f"{path} is not a folder; of a NetQMPI program {text}")
        return [f"{RANK}{number}" for number in range(ranks)]
    if ranks is not None:
        raise BadInput(f"--ranks {ranks} is for a NetQMPI program, FILE.py, which {path} is not")
    return _roles_in(path)


def _roles_in(folder: Path) -> list[str]:
    files = sorted(folder.glob(f"{PREFIX}*{SUFFIX}"))
    if not files:
        raise BadInput(f"{folder} has no {PREFIX}ROLE{SUFFIX}: name a NetQASM application's folder")
    return [file.name[len(PREFIX) : -len(SUFFIX)] for file in files]


def placement(
    roles: Sequence[str], placed: Mapping[str, Any], hosts: Sequence[str]
) -> dict[str, str]:
    """Return the host of each role: the one that is named, of its own name, or free."""
    for role, host in placed.items():
        _require(role, roles, "roles.yaml or --place")
        if host not in hosts:
            raise BadInput(f"{role} on {host}: {remedy(host, hosts)} (--place)")
    chosen = {role: role for role in roles if role in hosts} | dict(placed)
    free = [host for host in hosts if host not in chosen.values()]
    for role in roles:
        if role not in chosen:
            if not free:
                text = f"{len(roles)} roles and {len(hosts)} hosts: choose a larger --topology"
                raise BadInput(text)
            chosen[role] = free.pop(0)
    if len(set(chosen.values())) < len(chosen):
        raise BadInput(f"two roles on one host: {assigned(chosen)}; give each its own (--place)")
    return {role: chosen[role] for role in roles}


def play(
    application: Application,
    copies: CarriedApplication,
    network: Network,
    folder: Path,
    outputs: list[Round],
    look: Callable[[], None] = lambda: None,
    label: str = "",
) -> None:
    """Start the programs, and note what they return until all have ended; `look` meanwhile."""
    addresses = {role: network.runtime.addresses[host] for role, host in application.hosts.items()}
    placed = json.dumps({"hosts": dict(application.hosts), "addresses": addresses})
    roles: dict[str, str] = {}

    def note(program: Program, line: Line) -> None:
        if line.get("event") == "result":
            number = line["round"]
            outputs.extend({} for _ in range(number + 1 - len(outputs)))
            outputs[number][roles[program.name]] = line["output"]

    programs = {
        role: _start(role, application, copies, network, placed, label) for role in addresses
    }
    roles.update((program.name, role) for role, program in programs.items())
    try:
        follow_all(network, list(programs.values()), note, look, NETQASM_STALL_TIMEOUT_S)
    except (TransferError, NetworkError):
        network.explain()
        raise
    finally:
        logs = folder / "netqasm"
        logs.mkdir(exist_ok=True)
        copies.come_back(network, logs)
        keep_logs(logs, map(network.runtime.written_folder, application.hosts.values()))


def keep_logs(folder: Path, written: Iterable[Path]) -> None:
    """Copy what programs have logged: files, and nothing that they have linked."""
    for file in (file for each in written for file in sorted(each.iterdir())):
        if file.is_file() and not file.is_symlink():
            shutil.copyfile(file, folder / file.name, follow_symlinks=False)


def _start(
    role: str,
    application: Application,
    copies: CarriedApplication,
    network: Network,
    placed: str,
    label: str,
) -> Program:
    host = application.hosts[role]
    logs, path = network.runtime.written_folder(host), copies.path_on(network, host)
    command = [python(), "-m", "applications.netqasm.program", str(path), role]
    command += ["--stack", network.runtime.socket(host), "--placement", placed]
    command += ["--inputs", json.dumps(application.inputs[role]), "--logs", str(logs)]
    command += ["--rounds", str(application.rounds)]
    if isinstance(network.runtime.time, SteppedTime):
        command += ["--time-folder", network.runtime.time.folder]
    return network.run_as_people_do(host, f"{label}netqasm-{role}", command)


def rows(outputs: Sequence[Round]) -> dict[str, str]:
    """Return the outputs to print: those of the last rounds."""
    shown = {}
    for number in range(max(0, len(outputs) - MOST_SHOWN), len(outputs)):
        for role, output in outputs[number].items():
            name = role if len(outputs) == 1 else f"{role}, round {number + 1}"
            shown[name] = json.dumps(output)
    return shown


def assigned(hosts: Mapping[str, str]) -> str:
    return ", ".join(f"{role} on {host}" for role, host in hosts.items())


def _placed(word: str) -> tuple[str, str]:
    role, equals, host = word.partition("=")
    if not equals:
        raise BadInput(f"--place {word}: write ROLE=HOST")
    return role, host


def _input(word: str) -> tuple[str, str, Any]:
    """Return role, name and value of an input; the value is read as YAML."""
    place, equals, text = word.partition("=")
    role, dot, name = place.partition(".")
    if not (equals and dot and name.isidentifier()):
        raise BadInput(f"--input {word}: write ROLE.NAME=VALUE, as alice.x=1")
    try:
        return role, name, yaml.safe_load(text)
    except yaml.YAMLError as error:
        raise BadInput(f"--input {word}: {error}") from error


def _require(role: str, roles: Sequence[str], what: str) -> None:
    if role not in roles:
        raise BadInput(f"{what} {role}: the application has {', '.join(roles)}")
