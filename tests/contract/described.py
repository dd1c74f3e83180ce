"""The configurations that programs of a described network get, where nothing of it is started.

Nodes and links are Mininet's and ours, without shells and interfaces; the words are those of the
command line.
"""

import atexit
import json
import os
from argparse import ArgumentParser
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import replace
from functools import cache, partial
from itertools import count
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pytest
from mininet.net import Mininet

from qmn.network.description import describe_network
from qmn.network.options import NetworkOptions, settings
from qmn.network.topologies import add_topology
from qmn.options import add_options, read
from topologies.links import copper_link, management
from topologies.links.copper_lengths import assign_copper_lengths
from topologies.links.fiber import Channel
from topologies.nodes import DispatcherHost, OpticalSwitch, QuantumController, QuantumHost
from topologies.nodes.copper import copper_config
from topologies.nodes.node import QuantumNode
from topologies.system.kernel import interfaces
from topologies.system.runs import runtime
from topologies.system.runs.launching import listeners, write
from topologies.system.runs.runtime import Runtime
from wire.config import Config

Configurations = dict[str, dict[str, Any]]  # by program
Flat = dict[str, Any]  # by path, as dispatcher.fibers.0.length_km


@contextmanager
def without_machine(folder: Path) -> Iterator[None]:
    """Make nodes that have no shell, and links that have no interfaces."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(runtime, "RUNTIME_ROOT", folder)
        patch.setattr(runtime, "_current", None)
        patch.setattr("secrets.token_hex", partial(next, map(str, count())))
        patch.setattr(Mininet, "inited", True)
        patch.setattr(QuantumNode, "startShell", lambda *_, **__: None)
        patch.setattr(QuantumNode, "cmd", lambda *_, **__: "")
        patch.setattr(interfaces, "within", lambda *_, **__: "")
        patch.setattr(QuantumController, "_begin", lambda _: None)
        patch.setattr(management, "ip", lambda _: None)
        patch.setattr(management, "network_of", nullcontext)
        patch.setattr(copper_link, "lay", lambda *_: None)
        patch.setattr(copper_link, "_be_patient", lambda *_: None)
        patch.setattr(copper_link, "tap", lambda *_: os.open(os.devnull, os.O_RDONLY))
        patch.setattr(Channel, "makeIntfPair", lambda *_, **__: None)
        yield


def options(*words: str) -> NetworkOptions:
    """Return what the command line says of a network."""
    parser = ArgumentParser()
    add_topology(parser)
    add_options(parser, NetworkOptions)
    return read(NetworkOptions, parser.parse_args(words))


@cache
def folder() -> Path:
    """Return the folder of all networks, so that their paths are the same."""
    made = TemporaryDirectory(prefix="qmn-contract-")
    atexit.register(made.cleanup)
    return Path(made.name)


@cache
def configurations(*words: str, **of_run: bool) -> Configurations:
    """Return what each program reads when it starts, in a run; nobody changes it."""
    with without_machine(folder()):
        described = describe_network(options(*words))
        paced = replace(described.pace, stepped=False)  # there is no gate
        network = settings(described.options, folder() / "logs", paced, **of_run)
        try:
            runtime.begin(network)
            return dict(_configurations(network, described.build()))
        finally:
            network.remove()


def _configurations(network: Runtime, topo: Any) -> Iterator[tuple[str, dict[str, Any]]]:
    assign_copper_lengths(topo, network.settings.copper_km, network.settings.copper_mbps)
    net = Mininet(topo=topo, controller=QuantumController, build=False)
    net.buildFromTopo(topo)
    (c0,) = net.controllers
    c0.addresses = management.lay_management(c0, network.bridges, network)
    read_by = partial(_read_by, network)
    for node in (*net.hosts, *net.switches, *net.controllers):
        match node:
            case QuantumHost():
                yield node.name, read_by(node.name, node.stack_config())
            case DispatcherHost():
                yield "dispatcher", read_by("dispatcher", node.dispatcher_config())
            case OpticalSwitch():
                yield node.name, read_by(f"{node.name}-agent", node.agent_config(net.controllers))
            case QuantumController():
                yield "controller", read_by(node.name, node.controller_config())
    yield "copper", read_by("copper", copper_config(network))


def _read_by(network: Runtime, name: str, config: Config) -> dict[str, Any]:
    with listeners(network, name, type(config)) as own:
        found: dict[str, Any] = json.loads(write(network, name, config, own).read_text())
    del found["time_since_ns"]
    return found


def changes(words: Sequence[str], beside: Sequence[str] = ()) -> Flat:
    """Return what words on the command line change, beside others; None: what is not there now."""
    before = flat(configurations(*beside))
    after = flat(configurations(*words, *beside))
    return {
        path: after.get(path)
        for path in before.keys() | after.keys()
        if path not in before or path not in after or before[path] != after[path]
    }


def flat(value: Any, path: str = "") -> Flat:
    """Return the leaves of a configuration by their paths."""
    match value:
        case dict() if value and not path.endswith("_parameters"):  # of a model of one's own
            parts = value.items()
        case list() if value and isinstance(value[0], dict):
            parts = enumerate(value)  # type: ignore[assignment]
        case _:
            return {path: value}
    return {
        where: leaf
        for name, part in parts
        for where, leaf in flat(part, f"{path}.{name}" if path else str(name)).items()
    }
