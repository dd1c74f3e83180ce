"""The network that runs on this machine, as a second program finds it."""

import os
from pathlib import Path

from topologies.programs import NetworkError
from topologies.runtime import DISPATCHER, RUNTIME_ROOT, folders_of_running
from wire.config import BadConfig, DispatcherConfig


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
    if folders:
        raise NetworkError("the network is still starting; try again when it has started")
    raise NetworkError("no network runs on this machine; start one first, as with `qmn run sdc`")
