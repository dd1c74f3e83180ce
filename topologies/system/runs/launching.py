"""The start of our own programs: each gets its configuration in a file, and open sockets."""

import os
import socket
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

from mininet.node import Node

from topologies.system.machines.machine import Machine
from topologies.system.namespaces import machine_listener
from topologies.system.processes.programs import NetworkError, Program, python
from topologies.system.runs.elsewhere import carried
from topologies.system.runs.runtime import Runtime, loopback_listener
from wire.config import AgentConfig, Config, ControllerConfig, MeasuredConfig
from wire.network_time import SteppedTime


def launch(
    network: Runtime,
    name: str,
    module: str,
    config: Config,
    host: Node | None = None,
    descriptors: Sequence[int] = (),
) -> Program:
    """Start one of our programs with its configuration, in a host's namespace if given.

    Raise NetworkError for what cannot be on another machine than the first.
    """
    if (machine := getattr(host, "machine", None)) is not None:
        return launch_elsewhere(network, name, module, config, host, machine)
    program = network.program(name)
    with listeners(network, name, type(config)) as opened:
        path = write(network, name, config, opened)
        command = [python(), "-m", module, "--config", str(path)]
        inherited = [*descriptors, *opened.values()]
        program.start(command, host.pid if host else None, inherited, network.forks())
    return program


def launch_elsewhere(
    network: Runtime, name: str, module: str, config: Config, host: Any, machine: Machine
) -> Program:
    """Start a program of a host that is on another machine, which gets the files that it needs."""
    config = carried(network, name, config, host.name, machine)
    path = write(network, name, config, {})
    machine.put(path, path.read_bytes())
    program = network.program(name)
    program.start_elsewhere(machine, ["-m", module, "--config", str(path)], host.pid_there)
    return program


class EarlyStart:
    """A program that loads what it needs while its configuration is not known yet."""

    def __init__(
        self, network: Runtime, name: str, module: str, words: Sequence[str], host: Node
    ) -> None:
        self._network, self._name = network, name
        self.program = network.program(name)
        reader, writer = os.pipe()
        self._held = os.fdopen(writer, "wb")  # it reads its configuration when this is closed
        with listeners(network, name, ControllerConfig) as opened, os.fdopen(reader):
            self._descriptors = opened
            path = network.folder / f"{name}.json"
            command = [python(), "-m", module, "--config", str(path), "--after", str(reader)]
            descriptors = [reader, *opened.values()]
            self.program.start([*command, *words], host.pid, descriptors, network.forks())

    def go_on(self, config: Config) -> None:
        write(self._network, self._name, config, self._descriptors)
        self._held.close()

    def stop(self) -> None:
        self.program.stop()
        self._held.close()


def write(network: Runtime, name: str, config: Config, descriptors: dict[str, int]) -> Path:
    """Write the file of a program's configuration, with the network's time and its own sockets."""
    path = network.folder / f"{name}.json"
    time = network.time
    more: dict[str, Any] = {
        **descriptors,
        "time_scale": time.scale,
        "time_since_ns": time.since_ns,
    }
    if isinstance(time, SteppedTime):
        more |= {"time_folder": time.folder, "time_slot": next(network.time_slots)}
    replace(config, **more).write(path)
    return path


@contextmanager
def listeners(network: Runtime, name: str, kind: type[Config]) -> Iterator[dict[str, int]]:
    """Open the sockets that a program with such a configuration has from the runner.

    Give their descriptors by field. A socket stays in the network that it was opened in: the
    machine's.
    """
    with ExitStack() as stack:
        descriptors = {}
        if network.settings.metrics and issubclass(kind, MeasuredConfig):
            listener = loopback_listener(network.metrics_addresses, name)
            descriptors["metrics_fd"] = stack.enter_context(listener)
        if network.settings.gnmi and issubclass(kind, AgentConfig):
            listener = loopback_listener(network.gnmi_addresses, name.removesuffix("-agent"))
            descriptors["gnmi_fd"] = stack.enter_context(listener)
        if network.settings.rest and issubclass(kind, ControllerConfig):
            descriptors["rest_fd"] = stack.enter_context(rest_listener(network.settings.rest))
        yield {field: listener.fileno() for field, listener in descriptors.items()}


def rest_listener(address: str) -> socket.socket:
    """Return a socket of the machine's network on which the controller serves HTTP."""
    host, _, port = address.rpartition(":")
    try:
        return machine_listener(host, int(port))
    except (OSError, ValueError, OverflowError) as error:
        raise NetworkError(
            f"cannot serve HTTP on {address}: {error}; name another address for --rest, such as "
            "127.0.0.1:8080"
        ) from error
