"""The network that runs on this machine, as a second program finds it."""

import json
import os
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from qmn.results.run_result import NetworkResult
from topologies.networks.heard_orders import patience_s
from topologies.system.namespaces import keeper, keeper_is_gone
from topologies.system.processes.programs import NetworkError
from topologies.system.runs.runtime import (
    DISPATCHER,
    NONE_RUNS,
    RUNTIME_ROOT,
    Runtime,
    folders_of_running,
)
from wire.config import BadConfig, DispatcherConfig
from wire.results import schema
from wire.results.run_result import BEGUN, RESULT

NETWORK = "network.json"  # in the private folder of a network
KILLED = "its runner was killed"
STARTING = "the network is still starting; try again when it has started"


@dataclass(frozen=True)
class RunningNetwork:
    folder: str  # of its files
    since_ns: int  # as events and records are stamped
    time_scale: float
    stacks: dict[str, str]  # socket of each host's
    network: dict[str, Any]  # as results keep it
    datapath_ids: dict[str, int]  # of the quantum switches that our controller programs
    heard_in_s: float  # at most, until it has heard of a link


def announce_network(runtime: Runtime, facts: NetworkResult) -> None:
    """Tell other programs of a network that has started, and note that in the folder of its run."""
    assert facts.network is not None
    facts.write_begun(runtime.logs, keeper())
    stacks = {host: runtime.socket(host) for host in runtime.addresses}
    announced = RunningNetwork(
        str(runtime.logs),
        runtime.time.stamp_ns(),
        runtime.time_scale,
        stacks,
        facts.network.to_dict(),
        runtime.own_datapath_ids,
        patience_s(runtime),
    )
    (runtime.folder / NETWORK).write_text(json.dumps(asdict(announced)))


def announced_network() -> RunningNetwork:
    """Return the network that runs; raise NetworkError if none has started."""
    folders = folders_of_running(RUNTIME_ROOT)
    for folder in folders:
        file = folder / NETWORK
        if file.exists():
            return RunningNetwork(**json.loads(file.read_text()))
    raise NetworkError(STARTING if folders else NONE_RUNS)


def left_of_killed(folder: Path) -> dict[str, Any] | None:
    """Return a killed run's result so far, as its file would have it.

    None: it goes on, or has ended otherwise. Raise OSError or MalformedPacket.
    """
    if (folder / RESULT).exists() or not (folder / BEGUN).exists():
        return None
    runner, facts = schema.read_begun(folder)
    if not keeper_is_gone(runner):
        return None
    return {**facts, "error": KILLED}


def announced_folders() -> set[Path]:
    files = [folder / NETWORK for folder in folders_of_running(RUNTIME_ROOT)]
    return {Path(json.loads(file.read_text())["folder"]) for file in files if file.exists()}


def dispatcher_of_running_network(root: Path = RUNTIME_ROOT) -> DispatcherConfig:
    """Return the dispatcher's configuration; raise NetworkError if no network runs."""
    folders = folders_of_running(root)
    for folder in folders:
        if not os.access(folder, os.R_OK | os.X_OK):
            raise NetworkError(f"the network in {folder} belongs to root: run it with sudo")
        config = folder / f"{DISPATCHER}.json"
        if not config.exists():
            continue
        try:
            return DispatcherConfig.read(config)
        except BadConfig as error:
            raise NetworkError(f"the network in {folder} is of another version: {error}") from error
    raise NetworkError(STARTING if folders else NONE_RUNS)
