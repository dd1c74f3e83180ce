"""The program that holds packets back on long copper, beside the nodes."""

import os

from topologies.system.runs.launching import launch
from topologies.system.runs.runtime import Runtime
from topologies.timeouts import READY_TIMEOUT_S
from wire.config import CopperConfig

COPPER = "copper"


def connect_copper(network: Runtime) -> None:
    """Start what holds packets back on long copper, if there is some, before any are sent."""
    if not network.cables:
        return
    files = [file for cable in network.cables for file in (cable.a_fd, cable.b_fd)]
    program = launch(network, COPPER, "copper", copper_config(network), descriptors=files)
    for file in files:
        os.close(file)  # the program has them
    network.cables.clear()
    program.wait_for("ready", READY_TIMEOUT_S)


def copper_config(network: Runtime) -> CopperConfig:
    simulation = network.dispatcher.partition(":")[0]
    return CopperConfig(list(network.cables), simulation, network.settings.seed)
